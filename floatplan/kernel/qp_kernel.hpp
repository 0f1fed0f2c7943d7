// What qp.hpp is given and gives back: the structure of quadratic.py, member by member.
#pragma once
#include <cstdint>

// minimise x H x / 2 + g x subject to A x + c = 0 and C x + k >= 0.
struct Quadratic {
    std::int64_t size, equalities, rows, most;  // most: rounds, and rows added in each
    double tolerance;                           // by which a row may be violated
    const double *hessian, *gradient;           // (size, size), (size)
    const double *equality_rows, *equality;     // A (equalities, size), c
    const double *inequality_rows, *inequality;  // C (rows, size), k
    double *x, *multipliers;                     // (size); y (equalities), then z (rows): H x + g + A^T y - C^T z = 0
    double *room;                                // 2 size^2 + 5 (size + 1)
    std::int64_t *active, *violated;             // (size), (rows)
};
