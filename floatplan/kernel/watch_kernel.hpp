// What watch.hpp and minima.hpp are given and give back.
#pragma once
#include <cstdint>

// What is asked of a motion's rows.
enum class Asked : std::int64_t { rates, values, drift, jacobian, gradient };

enum RowKind : std::int64_t { sum_row, circle_row, bar_row, half_plane_start_row, half_plane_end_row, pair_row };

// What is watched of the flights of a robot: a planar tree, its capsules, and rows. Units m, kg, s, rad.
struct Watch {
    std::int64_t joints, bodies, capsules, rows, needs_moments, needs_accelerations, needs_places;
    double turn;
    const double *turns, *offsets, *inertia;         // (bodies, joints), (bodies), (bodies)
    const double *real, *imaginary;                  // C (bodies, bodies)
    const double *ends_real, *ends_imaginary;        // (capsules, 2, bodies): weights of start and end
    const double *radius, *path;                     // (capsules); of the CM: place, velocity, gravity
    const double *obstacles;                         // (obstacles, 7): place, end or normal, velocity, radius
    const std::int64_t *kind, *first, *second;       // (rows): capsule or sum; obstacle or capsule
    const std::int64_t *opposite;                    // (rows): an earlier row of opposite derivatives, or -1
    const double *least, *per_scale;                 // (rows) of distances
    const double *sums;  // (sums, 2 + 2 joints + bodies): constant, of theta0', velocities, accelerations, moments
};

// One motion at some instants, and by what its rows change.
struct Watched {
    std::int64_t instants, size;
    double momentum, per_second, back_off;
    const double *positions, *velocities, *accelerations;  // (instants, joints)
    const double *times, *attitude;                        // (instants)
    const std::int64_t *wanted;                            // (instants, rows): where a row goes, negative: nowhere
    const double *sine, *cosine, *p_rate, *curvature;      // (instants, joints) of JointMotion
    const double *basis;                                   // (3, instants, size): by x, of p and its derivatives
    const std::int64_t *columns;                           // (joints + 1): where each joint's x begin; then h
    const double *axes;                                    // of h, by the rest of x
    const double *attitude_slopes;                         // (instants, size)
    // kept, where watch_room() of watch.hpp says
    double *rate, *by_momentum, *base_acceleration, *turned_sine, *turned_cosine;  // (instants)
    double *by_velocity, *by_position;                                             // (instants, joints)
    double *real, *imaginary, *turned_real, *turned_imaginary, *moments;           // (instants, bodies)
    double *ends;                                                                  // (instants, capsules, 2, 2)
    double *nearest;                                                               // (wanted, 4)
    double *scratch;
};

// A whole motion, as sums of Chebyshev polynomials in 2 s - 1; of the orientation too.
struct Course {
    std::int64_t terms, turned_terms;
    double duration, momentum;
    const double *p, *p_rate, *p_curvature;  // (terms, joints)
    const double *turned;                    // (turned_terms)
    const double *centre, *amplitude;        // (joints)
};

// Local minima of rows: those of each row between low and high, from a look at a grid of instants.
struct Minima {
    std::int64_t instants;
    double near, span;
    const double *grid, *low, *high;  // (instants), (rows), (rows)
    std::int64_t found, looked;  // looked: at so many instants beside the grid
    std::int64_t *row;  // (found), of instants times rows
    double *s, *least;  // (found), the same
};
