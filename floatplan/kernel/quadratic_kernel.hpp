// What quadratic.hpp is given and gives back.
#pragma once
#include <cstdint>

// minimise x H x / 2 + g x subject to c + A x = 0 and d + C x >= 0, from rows of C that may be active.
struct Quadratic {
    std::int64_t size, equalities, rows, changes;
    double accuracy, tolerance;
    const double *hessian, *gradient, *equality, *equality_rows, *inequality, *inequality_rows;
    std::int64_t count;     // of the active rows
    std::int64_t *active;   // (size + 1)
    double *solution;       // (2 size + equalities): x and multipliers, those of active rows <= 0
};
