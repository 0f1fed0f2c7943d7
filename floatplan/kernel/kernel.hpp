// What the kernel is given and gives back; layout.py reads it from here, and from the other headers *_kernel.hpp.
#pragma once
#include <cstdint>

// Counts that must be multiples of 8 or 32: several instants are computed at once, none of them alone.
using Eights = std::int64_t;
using ThirtyTwos = std::int64_t;

// A planar tree as its momentum needs it. Bodies that turn alike are one; body 0 is the base and turns by nothing.
struct Robot {
    std::int64_t joints, bodies, width;  // width: free polynomials of the joint that has most
    const std::int64_t *free;            // (joints)
    const double *real, *imaginary;      // C (bodies, bodies), kg m^2, moments of inertia on its diagonal
    std::int64_t is_real;                // whether C is
    // The angle of body a is that of body parent[a] < a, and ratio[e] sin p of joint[e], e from first[a] to first[a+1].
    const std::int64_t *parent, *first, *joint;
    const double *ratio;
};

// Gauss-Legendre nodes on [0, 1]; a grid that there is not has no nodes.
struct Grid {
    Eights nodes;
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
    std::int64_t starts, first_start, most_starts, easy_iterations, wanted_after_failure, starts_to_agree, agreeing;
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

// What a law of corrections foresees of the motion that it chose.
struct Corrected {
    double miss, share;
    std::int64_t evaluated;
};

// A flight that is corrected, see inflight/update.py; what is of the plan first, then what changes from call to call.
// n joints, g groups of the m bodies: those that turn alike; K instants, first the nodes; 6 + width columns of the basis of p.
struct Flight {
    Eights instants;
    std::int64_t joints, groups, bodies, width, nodes, gap_nodes, memory, blocks, torque_rows, most_rows;
    std::int64_t most_rows_of_all, capsules;
    double turn, goal, length_scale;
    const double *centre, *amplitude;                // (n)
    const double *turns;                             // (g, n)
    const std::int64_t *group;                       // (m)
    const double *weights;                           // (nodes)
    const double *value, *first, *second;            // (columns, K)
    const double *free_value, *free_first, *free_second;  // (K, width), of changes y
    const double *whitening;                         // (width, width)
    const double *table, *points, *of_values;        // (3, columns, columns), (columns), (columns, columns)
    const double *at_landing;                        // (3, n)
    const double *gap, *gap_weights;                 // (gap_nodes)
    // Rows of limits, block by block.
    const std::int64_t *block_first;                 // (blocks + 1)
    const double *aim, *softness;                    // (blocks)
    const std::int64_t *row_kind, *row_joint;        // (rows)
    const double *row_limit, *row_slope;             // (rows)
    const double *row_turns, *row_ratios;            // (rows, m), (rows, n)
    // Distances: row_joint is a capsule, row_limit the margin.
    const std::int64_t *row_shape, *row_other;       // (rows): of watch_kernel.hpp; obstacle or capsule
    const double *row_window;                        // (rows, 2)
    const double *obstacles, *radius;                // (obstacles, 7) as in watch_kernel.hpp, (capsules)
    const double *ends_real, *ends_imaginary;        // (capsules, 2, g): places from the CM by the groups' rotations
    const double *s, *integrals;                     // (K), and (K - nodes, nodes) of the turn until then
    // The law's constants.
    double sigma, acceleration, far, weighed, settled, shorter, kept, scales[2];
    std::int64_t evaluations_near, evaluations_far;
    // The filter's.
    const double *mass, *nominal_inertia;            // (m)
    const double *own_real, *own_imaginary;          // (m, m): places of the centres of mass by the bodies' rotations
    const double *weights_real, *weights_imaginary;  // (m, g): the same by the groups'
    const double *nominal_real, *nominal_imaginary;  // (m, g): C with the plan's masses
    const double *wander, *deviations;               // (2 + 2 m)
    double angle_variance, rate_variance, largest_error, surprising;
    std::int64_t most_surprises;
    // What changes.
    double *state, *covariance;                      // (2 + 2 m), square
    std::int64_t *surprises;
    double *rows_real, *rows_imaginary;              // (m, g): C of the masses found
    double *merged_real, *merged_imaginary;          // (g, g): the same, moments of inertia on the diagonal
    double *inertia;                                 // (m)
    double *motions;                                 // (memory, 2 + 3 columns n): begin, end, p and two derivatives
    std::int64_t newest, known;
    // Of one call: what is measured and when, s, and what comes of it.
    double began, measured, now, landing, measured_orientation, measured_rate;
    double *measured_positions, *measured_velocities;  // (n)
    double *positions, *velocities, *map, *path;     // (n), (n), (n + 1); of the CM: place, velocity, gravity
    double turn_before, turn_after, expected_rate, aside, variance, noise;
    std::int64_t evaluations, is_warm;
    double *warm_start, *coefficients, *worst;       // (width, n), (columns, n), (blocks)
    Corrected corrected;
    double *scratch, *law_memory, *ahead_memory, *filter_memory, *gap_memory, *drift;  // drift: (nodes, n width)
};

enum Step : std::int64_t {
    remember_motion, expect_state, learn_state, adapt_masses, rewrite_motion, correct_motion
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
    ThirtyTwos nodes;
    std::int64_t points;         // of the finer grid, some of them nodes
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

enum Status : std::int64_t { infeasible, feasible, optimal, needs_grid };
