// What the kernel is given and gives back: the structures of library.py, member by member.
#pragma once
#include <cstdint>

// A planar tree as its momentum needs it. Bodies that turn alike are one; body 0 is the base and turns by nothing.
struct Robot {
    std::int64_t joints, bodies, width;  // width: free polynomials of the joint that has most
    const std::int64_t *free;            // (joints)
    const double *real, *imaginary;      // C (bodies, bodies), kg m^2, moments of inertia on its diagonal
    std::int64_t is_real;                // whether C is
    // The angle of body a is that of body from[a] < a, and ratio[e] sin p of joint[e], e from first[a] to first[a+1].
    const std::int64_t *from, *first, *joint;
    const double *ratio;
};

// Gauss-Legendre nodes on [0, 1]; a grid that there is not has no nodes.
struct Grid {
    std::int64_t nodes;
    const double *weights;        // (nodes)
    const double *value, *slope;  // (6 + width, nodes): basis of p, and its derivative by s
    const double *tail;           // (3, nodes): the last Legendre coefficients
};

// Columns of the basis in powers of s, and by which powers a rounding is made up for; each as a sum of two doubles.
struct Powers {
    const double *columns, *columns_low;  // (6 + width, 6 + width)
    const double *lost, *lost_low;        // the same shape
};

struct Stage {
    double feasibility, optimality, quadrature_error;
    std::int64_t iterations;
};

struct Settings {
    Stage stages[3];  // rough, nearly resolved, fine
    double longest_step, coarsely_resolved, too_wild, hopeless, tolerance, unresolved, smallest_tail, largest_tail;
    double armijo, penalty_factor, penalty_kept, shortest_step, shortening_least, shortening_most, largest_multiplier;
    double damping, slack_penalty, largest_curvature, polished;
    double hopeless_way, changed_branches, step_to_rank, agreement;
    std::int64_t slow_evaluations, slow_steps, polishing_steps, most_rounds, most_iterations;
    std::int64_t first_level, levels, finer;  // finer: levels to twice the nodes
    std::int64_t level_of_starts, candidates, followed, ranked_rounds, steps_to_rank;
    std::int64_t starts, most_starts, easy_iterations, wanted_after_failure, starts_to_agree, agreeing;
    std::uint64_t seed;
    double spreads[6];
};

// One row for each problem; coefficients (joints, 6 + width), z (joints, width), boundary (joints, 6).
struct Batch {
    std::int64_t count;
    const double *duration, *momentum, *change, *boundary;
    const double *start;  // z to begin from; null: the plain motion
    std::int64_t *status, *iterations, *evaluations, *instants, *starts, *solved;
    std::int64_t *branch;  // (joints), at landing, against the boundary given
    double *objective, *residual, *z, *coefficients;
};

// The rest of a flight; z, y (joints, width), boundary (joints, 6), whitening (width, width).
struct Rest {
    double duration, momentum, change, sigma, stiffness, settled, shorter;
    std::int64_t evaluations;
    const double *boundary, *z, *whitening, *amplitude;
    double *y;
    double miss;
    std::int64_t evaluated;
};

// How the bodies of a tree are turned by moments, and these by its motors. Body i turns as body group[i] of the robot.
struct Moments {
    std::int64_t bodies, motors;
    const std::int64_t *group;
    const double *real, *imaginary;  // (bodies, those of the robot), kg m^2: C, moments of inertia on the diagonal
    const double *turns;             // (bodies, motors)
    const double *amplitude;         // (joints), rad
};

// Chebyshev nodes on [0, 1], and a finer grid to look for the largest value on.
struct Interpolation {
    std::int64_t nodes, points;  // nodes: a multiple of 32; points: of the finer grid, some of them nodes
    const double *curvature;     // (6 + width, nodes): second derivatives of the powers of s
    const double *to_cosines;    // (nodes, nodes), by columns: from values at the nodes to factors of cos(j phi)
    const double *to_fine;       // (points, nodes): from values at the nodes to those on the finer grid
};

// One row for each plan; coefficients (joints, 6 + width) in powers of seconds.
struct Peaks {
    std::int64_t count, levels, velocities;  // velocities: whether they are measured too
    double resolved;
    const double *duration, *momentum, *coefficients;
    double *peaks;  // (motors), or (motors + joints)
};

enum Status : std::int64_t { infeasible = 0, feasible = 1, optimal = 2, needs_grid = 3 };
