// The kernel's interface, in plain C: what it is given and returns. C++ includes it, structs.py gives it to cffi.
//
// Arrays are contiguous, C order; their shapes stand behind them. An array that is not there is null.
#pragma once
#include <stdint.h>

typedef int64_t Index;

// Counts that must be multiples of 8: several instants are computed at once, none of them alone. A type of its own, as wide
// as Index, so that whoever reads this header sees which counts these are.
typedef long long Eights;

// A planar tree, see bodies.py. Bodies that turn alike are one; body 0 is the base and turns by nothing.
typedef struct {
    Index joints, bodies;
    const double *real, *imaginary;      // C (bodies, bodies), kg m^2, moments of inertia on its diagonal
    Index is_real;                // whether C is
    // The angle of body a is that of body parent[a] < a, and ratio[e] sin p of joint[e], e from first[a] to first[a+1].
    const Index *parent, *first, *joint;
    const double *ratio;
    // Each link on its own, for the moments that turn them: link i turns as body group[i].
    Index links;
    const Index *group;
    const double *link_real, *link_imaginary;  // (links, bodies): rows of C, moments of inertia with the own body
    Index has_rotors;
    const double *rotors;  // (links, joints), or null: moments that turn the motors' rotors, by accelerations
} Robot;

// A motion at some instants: arrays (.., stride), stride a multiple of 8 so that several instants are computed at once.
typedef struct {
    Index instants, stride;
    double per_second;
    double *position, *sine, *cosine, *p_rate, *p_curvature, *speed, *acceleration;  // (joints), see swing_joints()
    double *angle, *body_cosine, *body_sine, *swing, *inertia, *turned;  // (bodies), see turn() of tree.hpp
    double *relative, *x, *y, *moment;           // (bodies), the last one (links), see move_bodies()
    double *rate, *inverse, *base_acceleration;  // theta0', 1 / D_0, theta0''
    double *by_position, *by_speed;              // (joints): of theta0'
    double *time, *attitude, *attitude_cosine, *attitude_sine;
    double *end_x, *end_y, *end_z;                              // (capsules, 2), the last one in space alone
    double *by_angle, *by_swing, *moving_cosine, *moving_sine;  // to work in: (bodies, 8)
    double *by_joint, *by_joint_rate;                           // (joints, 8)
    double *weights, *by;                                       // (terms, 8), (3 joints + 1, 8)
    double *gathered, *value;                                   // (links), ()
} Motion;

// Columns of the basis in powers of s, and by which powers a rounding is made up for; each as a sum of two doubles.
typedef struct {
    const double *columns, *columns_low;  // (6 + width, 6 + width)
    const double *lost, *lost_low;        // the same shape
} Powers;

typedef struct {
    double feasibility, optimality, quadrature_error;
    Index iterations;
} Stage;

typedef struct {
    Stage stages[3];  // rough, nearly resolved, fine
    double longest_step, coarsely_resolved, too_wild, hopeless, tolerance, unresolved, smallest_tail, largest_tail;
    double armijo, penalty_factor, penalty_kept, shortest_step, shortening[2], largest_multiplier;
    double damping, slack_penalty, largest_curvature, polished;
    double hopeless_way, changed_branches, step_to_rank, agreement;
    Index slow_evaluations, slow_steps, polishing_steps, most_rounds, most_iterations;
    Index first_level, levels, finer;  // finer: levels to twice the nodes
    Index level_of_starts, candidates, followed, ranked_rounds, steps_to_rank;
    Index easy_iterations, wanted_after_failure, starts_to_agree, agreeing;
    double spreads_of_starts[6];
} Settings;

// Chebyshev nodes s on [0, 1].
typedef struct {
    Eights nodes;
    const double *s, *map;                    // (nodes), (nodes, nodes): Chebyshev coefficients from values there
    const double *value, *slope, *curvature;  // (columns, nodes): powers of s and their derivatives
} Interpolation;

// In this order: first those of sums, up to share_row, then those of distances: to a disc or ball, to a bar, of either end of
// a capsule to a half-plane or half-space, to a box in space, and between two capsules. A share_row is what the magnitudes of two sums leave of
// 1: corrections in flight have it; a search has a sum_row for each pair of signs.
typedef enum {
    sum_row, share_row, ball_row, bar_row, wall_start_row, wall_end_row, box_row, pair_row
} RowKind;

// Rows of constraints of a robot's flights: distances of its capsules, sums of moments and rates, and what two sums'
// magnitudes leave of 1. Units m, kg, s, rad.
typedef struct {
    Index capsules, rows, needs_moments, needs_accelerations, needs_places;
    double turn;                                     // 1, or -1 where the robot's bodies are mirrored
    const double *ends_real, *ends_imaginary;        // (capsules, 2, bodies): weights of start and end, in a plane
    const Index *body;                               // (capsules), of the tree, in space
    const double *ends;                              // (capsules, 2, 3): start and end in that body's axes, in space
    // The last of the capsules are hulls in space: both of their ends are the lowest point of points, from hull_first[i] to
    // hull_first[i+1], grown by an ellipsoid.
    Index hulls;
    const Index *hull_first;                         // (hulls + 1)
    const double *hull_points, *hull_axes;           // (points, 3), (hulls, 3, 3): semi-axes
    const double *radius;                            // (capsules)
    const double *path;                              // of the CM: place, velocity, gravity
    const double *obstacles;                         // (obstacles, 7 or 10): place, end or normal, velocity, radius
    const Index *kind, *first, *second;       // (rows): capsule or sum; obstacle, capsule, or sum (-1: none)
    const Index *opposite;                    // (rows): an earlier row of opposite derivatives, or -1
    const double *margin, *per_scale;                // (rows) of distances
    const double *sums;  // (sums, 2 + 2 joints + links): constant, of theta0', velocities, accelerations, moments
} Constraints;

// How joints and h depend on so many variables x.
typedef struct {
    Index size;
    Eights stride;
    const double *basis;      // (3, size, stride): by x, of p and its derivatives at instants
    const Index *columns;     // (joints + 1): where each joint's x begin; then h
    const double *axes;       // of h, by the rest of x
    const double *of_axes;    // (3, joints, axes, stride): p by these too, or null
} Variables;

// A whole motion, as sums of Chebyshev polynomials in 2 s - 1; of the orientation too.
typedef struct {
    Index terms, turned_terms;
    double duration, momentum;
    const double *p, *p_rate, *p_curvature;  // (terms, joints)
    const double *turned;                    // (turned_terms)
    const double *centre, *amplitude;        // (joints)
} Series;

// Local minima of rows: those of each row between low and high, from a look at a grid of instants.
typedef struct {
    Index instants;
    double near, span;
    const double *grid, *low, *high;  // (instants), (rows), (rows)
    Index found, looked;  // looked: at so many instants beside the grid
    Index *row;  // (found), of instants times rows
    double *s, *value;  // (found), the same
} Minima;

// One row for each plan; coefficients (joints, columns) in powers of seconds; centre and amplitude (joints), rad.
typedef struct {
    Index count, levels, columns, motors, orders;  // orders: how many derivatives of the joints are measured too
    double resolved;
    const double *turns;  // (links, motors)
    const double *centre, *amplitude, *duration, *momentum, *coefficients;
    double *peaks;        // (motors + orders joints)
    // Where distances to obstacles are measured: what of their constraints is a row's own, and when.
    Index numbers;        // of a row's obstacles
    const double *orientation, *path, *obstacles, *low, *high;  // (), (5), (numbers), (rows), (rows)
    Minima minima;
    double *clearance;
} Peaks;

// minimise x H x / 2 + g x subject to c + A x = 0 and d + C x >= 0, with at most so many changes of the active rows. C is
// given as packs (size, 8) of 8 rows each.
typedef struct {
    Index size, equalities;
    Eights rows;
    Index changes;     // of active rows: how many there may be, and afterwards, how many there were
    double tolerance;
    const double *hessian, *gradient, *equality, *equality_rows, *inequality, *inequality_rows;
    Index count;       // of the active rows
    Index *active;     // (size)
    double *solution;  // (2 size + equalities): x, multipliers y of equalities and z >= 0 of active rows:
                       // H x + g + A^T y - C^T z = 0
} Quadratic;

// Gauss-Legendre nodes of one level, and what motions of a form are made of there.
typedef struct {
    Eights nodes;
    const double *s, *weights, *tail;        // (nodes), (nodes), (3, nodes): the last Legendre coefficients
    const double *value, *first, *second;    // (columns, nodes): basis of p, and its derivatives by s
    const double *integrals;                 // (nodes, nodes): of what is 1 at one alone, over [0, s]
    const double *antiderivative;            // (nodes + 1, nodes): in Chebyshev polynomials of 2 s - 1
} Nodes;

// The conditions (13) at one end where they follow h: rates p' by s, straight between some h, and p'' of these.
typedef struct {
    Index knots;                             // 0: they are given
    const double *momenta, *rates;           // (knots), (knots, joints)
    const double *curvature, *bend;          // (joints): p'' = curvature + bend p'^2
} End;

// A class of motions, and how the x of a search make one: z = offset + scaling x, h = momentum + axis x.
typedef struct {
    Index size, axes, columns, fixed_columns, terms;  // axes: whether h is free; fixed_columns: the conditions (13)
    double duration, orientation, change, momentum;
    const double *axis;                       // (axes)
    const double *centre, *amplitude;         // (joints)
    const Index *first;                       // (joints + 1): where each joint's x begin; then h
    const Index *condition;                   // (6): column of each condition (13), or -1
    const double *boundary;                   // (joints, fixed_columns)
    const double *offset, *scaling;           // (m), (m, m): joint by joint
    const double *series;                     // (3, terms, columns): the basis and its derivatives by Chebyshev's
    const double *map;                        // (terms, columns): to b over the unit, where that is minimised and x are not whitened; else null
    End start, goal;
} Motions;

// What a search for a motion with constraints keeps to; units and reasons stand in tolerances.py, as of Settings.
typedef struct {
    double back_off, reach, near_end, inside_enough, tight, watched, same_instant, beside, promising, least_curvature;
    double nearly_promising, elastic_stalled;
    double longest_free_step, momentum_curvature, between_left;
    double feasible, stalled, least_gain, far, initial_damping, smallest_damping, largest_damping;
    double regularisation, qp_tolerance;
    double evaluation, differentiation, entry, solving;  // work: of a program, and of an operation of a quadratic one
    double near_miss, same, enough_work, long_work, share_unconstrained;
    double smallest_step, least_scale;
    Index stall_iterations, iterations, passes, elastic_iterations, qp_changes, most_instants, cheap_level;
    Index compiled_level, constrained_level, closer, watched_at_most;
    double looked_ahead, value_kept;
    Index begins_with_active;
} Exchange;

// One search: starts followed to their ends, by number. Number 0 is the x that comes in, others are sampled. It is input and
// output in one: the caller fills the first group, x and the grid of the minima, and gives arrays for the others, which the
// kernel overwrites whatever they hold.
typedef struct {
    // What is searched for.
    Index first, count;                       // numbers: of the first start, how many at most (0: x is judged as it is)
    Index wanted;                             // that hold, of which the best is chosen (0: the first)
    Index rows, at_once, objective_sum, objective_sums;
    Index compares;                           // whether optima without rows are compared with the first: |b| is the objective
    double most_work, bodies, entries;
    double thickness;                         // m, the least one of an obstacle; infinite where there is none
    const double *plain;                      // (size): the x of the plain motion
    double reach;                             // m, of the point that stays nearest to the CM; 0: nothing is tested first
    const double *low, *high, *tolerance;     // (rows): windows in s, and what a value may be below 0
    const Index *at_ends;                     // (rows): whether x changes it at takeoff or landing
    const double *instants;                   // (fixed): beside the nodes, always
    Index fixed;
    // Read, then written.
    double *x;                                // (size): start number 0, then the best end
    Minima minima;                            // grid and span come in; then those of where the search ended
    // What the plain motion tells, for all starts.
    Index level, closer_level;
    double objective_scale;
    Index ends_hold, path_is_clear;           // 0 where nothing was tested
    double *end_values;                       // (rows, 2): values of rows at takeoff and at landing; null: not wanted
    // The result.
    Index started, solved;                    // how many starts were followed, how many hold
    double violation, work;                   // the largest one of (14) or of a row, 0 where all hold
    double missed[3];                         // what the attitude at landing lacks, with its signs: (14), or in space
    double objective;                         // of that: at the finest nodes, where it is one of sums, or |b|
    double *coefficients;                     // (joints, 6 + width): b of that, in powers of seconds; null: not wanted
    Index status, iterations, evaluations, judged_level;
} SearchProblem;

// A program at one x, at the nodes of a level and at other instants, all rows differentiated; and its elastic step, for a
// penalty and with the Hessian that is guessed.
typedef struct {
    Index level, extra;
    const double *others, *x;                 // (extra), rising; (size)
    double back_off, penalty, objective;
    double *equality;                         // (equalities)
    double *gradient, *row, *hessian, *step;  // (size), of the equalities (.., size), (size, size), (size)
    double *values, *slopes;                  // (rows, instants ..), (rows, instants .., size)
} Evaluation;

// How starts are drawn, each by the seed and its number alone.
typedef struct {
    Index level, random;                      // of grids; how many motions the start is one of
    double spreads[6];                        // how wild these are
    uint64_t seed;
    Index fractions;                          // 0: none
    const double *fraction;                   // (fractions) of the reach of h: the x given, there, in turns with others
    const double *offset_map;                 // (m, fixed_columns): by which the offset follows the boundary, or null
    Index *branch;                            // (joints), at landing, against the boundary given
} SamplingOptions;

// What a correction leads to.
typedef struct {
    double miss[3], fraction;  // in a plane the first alone
    Index evaluated;
} Corrected;

// Constants of corrections and of the filter.
typedef struct {
    Index gap_nodes, memory, most_rows, evaluations_near, evaluations_far, most_surprises;
    double far, weighed, settled, shorter, kept, taken_back, scales[2];
    double angle_noise, rate_noise, largest_error, surprising, believable, outlier_noise;
} CorrectionOptions;

// A tree of bodies in space; body 0 is a free base, body j + 1 is moved by joint j, which turns about an axis or slides.
typedef struct {
    Index joints;
    const Index *parent, *slides;             // (joints): the body before it, at most j; whether it slides
    const double *axis, *turned, *placed;     // (joints, 3), (.., 3, 3), (.., 3): the joint's frame in its parent's
    const double *mass, *first, *second;      // (joints + 1), (.., 3), (.., 3, 3): sums of m, m x, m x x^T in own axes
    const double *armature;                   // (joints)
} SpatialTree;

// A motion of it at some instants; null: not given, or not asked. See space.hpp.
typedef struct {
    Index instants;
    const double *positions, *velocities, *accelerations, *rates;  // (instants, joints), the last one (instants, 3)
    double *inertia, *joint_map, *slopes;  // (instants, 3, 3), twice (.., 3, joints)
    double *torques, *base_acceleration;   // (instants, joints), (instants, 6)
    double *torque_slopes;                 // (instants, joints, 3 joints + 3)
} SpatialMotion;

// Where its bodies are at some instants: the world's frame, the base's, and those that the joints move. See bodies.hpp.
typedef struct {
    Index instants;
    const double *base, *attitudes, *positions;  // (instants, 3), (.., 3, 3), (.., joints)
    double *places, *rotations;                  // (instants, joints + 2, 3), (.., 3, 3): all but the world's are written
} SpatialPoses;

// Groups of convex solids, each the hull of points grown by an ellipsoid, and where their bodies are: what is lowest of
// them, or how far those of their points reach that are no higher than a level. See bodies.hpp.
typedef struct {
    Index instants, bodies, solids, groups;
    const Index *body, *group, *first;       // (solids), (solids), (solids + 1): the first one of its points
    const double *points, *axes;             // (points, 3), (solids, 3, 3): in the body's frame, semi-axes as columns
    const double *places, *rotations;        // (instants, bodies, 3), (.., 3, 3)
    double *lowest;                          // (instants, groups, 3), in the world
    Index directions;
    const double *levels, *direction;        // (instants, groups), (directions, 2): unit vectors, horizontal
    double *reach;                           // (instants, directions), from the world's origin
} PlacedSolids;

// Where a limb is to bring a point of its last body, and that body's attitude. See bodies.hpp.
typedef struct {
    Index instants, links, sweeps;
    const Index *chain, *moves;              // (links): joints from the base outwards, and whether each is moved
    const double *base, *attitudes;          // (instants, 3), (.., 3, 3)
    const double *local, *target, *attitude;  // (instants, 3): the point in its body, where it is to be; (.., 3, 3)
    double turn_weight, damping, settled;    // [m/rad], [m^2], [rad]
    double *positions;                       // (instants, links): where it begins, then the result
} LimbTargets;

// How its base turns in cells with as many stages each, K stages in all. See turning.hpp.
typedef struct {
    Index cells, stages, is_chained, sweeps;
    double duration, settled, largest;
    const double *integrals, *weights;      // (stages, stages), (stages)
    const double *momentum, *inertia, *relative;  // (3), (K, 3, 3), (K, 3): h, I, and A q'
    double *borders, *ends;                 // (cells, 3, 3)
    double *inverse, *attitudes, *rates;    // (K, 3, 3), (K, 3, 3), (K, 3)
    double *still_rates, *carried_rates;    // (K, 4): of the quaternions that make an attitude
    double *transitions, *turn_weights;     // (cells, 3, 3), (K, 3, 3)
    Index columns, instants;
    const Index *cell;                      // (instants)
    const double *drifts, *reached;         // (K, 3, columns), (instants, stages)
    double *turns;                          // (instants, 3, columns)
} Turning;

// What flies in space, see spatial_flight.hpp. Joint j of the tree is at reference[j] + sum of ratio[e] q[planned[e]], e from
// first[j] to first[j + 1].
typedef struct {
    SpatialTree tree;
    Index joints;                           // that are planned
    const Index *first, *planned;           // (tree joints + 1), ()
    const double *ratio, *reference;        // (), (tree joints)
    const double *start, *goal;             // (3, 3): attitudes at takeoff, and required at landing
    const Index *angles;                    // (3): the axes about which the goal's angles are, or null
    const double *change;                   // (3): by how much these change in flight, rad
    double wrong_turn, most_tilt, slowest;  // rad: another change, a tilt too near to 90 degrees; a turn not resolved
    const double *momentum, *axes;          // (3), (3, H): h = momentum + axes y
    Index needs_rates;                      // whether rows or sums depend on the base's rates, or on where it is
    Index sweeps;                           // this and the next as of Turning
    double settled, largest;
} SpatialBody;

// Cells of one level in which the base's turning is integrated.
typedef struct {
    Index cells, stages;
    const double *integrals, *weights;      // (stages, stages), (stages)
    const double *tail;                     // (2, stages): the last Legendre coefficients
    const double *antiderivative;           // (stages + 1, stages): in Chebyshev polynomials of 2 s - 1
} Cells;

// A flight that is corrected, see inflight/update.py; what is of the plan first, then what changes from call to call.
// n joints, g bodies and m links of the robot; K instants, first the nodes; 6 + width columns of the basis of p. e is 1 in a
// plane; in space it is 3, and m counts the bodies of the tree, or where torques are meant its joints. What is of one of the two
// alone is null, or zero, in the other.
typedef struct {
    Eights instants;
    Index width, nodes, blocks, motors;
    CorrectionOptions options;
    double goal, sigma, acceleration;                // goal: in a plane, rad
    Cells cells, gap_cells;                          // in space, of the remaining flight and between measurements
    const double *centre, *amplitude;                // (n)
    const double *weights;                           // (nodes)
    const double *value, *first, *second;            // (columns, K)
    const double *basis;                             // (3, n width, K), of changes y
    const Index *columns;                     // (n + 1): where each joint's y begin
    const double *whitening, *unwhitening;           // (width, width), (width, columns)
    const double *plan;                              // its motion, as one of `motions`
    const double *table, *points, *of_values;        // (3, columns, columns), (columns), (columns, columns)
    const double *at_landing;                        // (3, n)
    const double *gap, *gap_weights;                 // (gap_nodes)
    const Index *block_first;                 // (blocks + 1): rows of the constraints, block by block
    const double *aim, *softness;                    // (blocks)
    const double *row_window;                        // (rows, 2), s
    const double *turns;                             // (m, n + motors): of the links, by joints and motors
    const double *s, *integrals;                     // (K), and (K - nodes, nodes) of the turn until then
    // The filter's.
    const double *mass, *inertia;                    // (m)
    const double *by_mass_real, *by_mass_imaginary;  // (m, m, g): what C changes by, of relative errors of masses
    const double *weights_real, *weights_imaginary;  // (m, g): the same by the bodies'
    const double *nominal_real, *nominal_imaginary;  // (m, g): C with the plan's masses
    const double *wander, *deviations;               // (2 e + 2 m)
    // What changes.
    double *state, *covariance;                      // (2 e + 2 m), square
    double *attitude;                                // (3, 3), in space
    Index *surprises;                                // (e)
    double *link_real, *link_imaginary, *real, *imaginary;  // the robot's in a plane, of the masses found
    double *body_mass, *body_first, *body_second;    // the same of the tree in space
    double *motions;                                 // (memory, 2 + 3 columns n): begin, end, p and two derivatives
    Index newest, known;
    // Of one call: what is measured and when, s, and what comes of it.
    double began, measured, now, landing;
    double *measured_orientation, *measured_rate;    // angle or (3, 3), (e)
    double *measured_positions, *measured_velocities;  // (n)
    double *positions, *map;                         // (n): where the joints are to be; (n + 1)
    double *joints_off, *rate_off, *allowed;         // (2, n), (e), (e): of what is measured, see Expected in Python
    double *asked, *torques;                         // (3, n): a state of the joints; (n + motors), N m
    double *turn_before, *turn_after;                // angle or (3, 3)
    double *expected_rate, *aside, *noise;           // (e)
    Index evaluations, is_warm;
    double *warm_start, *coefficients, *planned, *worst;  // (width, n), twice (columns, n), (blocks)
    double *row_values, *torque_peak;                // (rows, K), (motors)
    Corrected corrected;
    double *room;                                    // what floatplan_flight_room() says
} CorrectedFlight;

// A motion in cells that each begin with an attitude of their own, see lifting.hpp; gaps, rad, go from the cells' ends to the
// next borders, at last to the goal. Instants are stage by stage, those of all cells side by side.
typedef struct {
    const double *x, *borders;              // (size), (cells, 3, 3)
    double *ends, *gaps;                    // (cells, 3, 3), (cells, 3)
    double *spun;                           // (2, cells, stages, 4): carried_rates and still_rates of Turning
    double *carried;                        // (cells, 3, cells, 3): turns of the ends that turns at the cells' ends make
    double *turns;                          // (cells, 3, size): turns of the ends that x makes where no gap changes
    Index is_right_way;                     // whether turns and tilt are those that are wanted
} Lifted;

// constant + sum_l amplitude_l cos(frequency_l . q + phase_l), and boxes of q, rad, to bound it on, cut in two or not.
typedef struct {
    Index joints;
    Eights terms;  // beyond the last one zeros
    double constant;
    const double *amplitude, *phase, *frequency, *influence;  // (terms), the last two (joints, terms) and (joints)
    Index count, cuts;
    const double *boxes;    // (count, 2 joints + 1): centres, half-widths, a lower bound that is known
    double *parts, *value;  // the same of what is bounded, lower halves before upper ones; at its centres
    double *pulls;          // (terms), to work in
} Cosines;

// What is wanted of Turning: its attitudes, how small turns go on in each cell, or where they lead.
typedef enum { attitudes, transitions, turns } Asked;

// Steps of an update of corrections, see flight.hpp.
typedef enum {
    remember_motion, expect_state, learn_state, adapt_masses, rewrite_motion, find_torques, predict_motion,
    correct_motion
} Step;

// Of a motion.
typedef enum { infeasible, feasible, optimal } Status;

// The functions of the library. Each takes which set of instructions it runs with, at most floatplan_instructions().

// Digests of the sources, and of all that made the library of them.
const char *floatplan_sources(void);
const char *floatplan_build(void);

// The widest set of instructions that this processor has and its system keeps: 0 the baseline, 1 AVX2 with FMA, 2 AVX-512.
Index floatplan_instructions(void);

// Measures a batch of plans, their distances to obstacles where there are constraints; returns 0, or 1 where there was no
// memory for it.
Index floatplan_peaks(const Robot *robot, const Interpolation *interpolations, const Constraints *constraints,
                      Peaks *peaks, Index instructions);

// How many numbers an update of a flight's corrections works in.
Index floatplan_flight_room(const Robot *robot, const Constraints *constraints, CorrectedFlight *flight, Index instructions);

// One step of an update of a flight's corrections.
void floatplan_flight(const Robot *robot, const Constraints *constraints, CorrectedFlight *flight, Index step,
                      Index instructions);

// The same two of a flight in space.
Index floatplan_flight_room_in_space(const SpatialBody *robot, const Constraints *constraints, CorrectedFlight *flight,
                                     Index instructions);
void floatplan_flight_in_space(const SpatialBody *robot, const Constraints *constraints, CorrectedFlight *flight, Index step,
                               Index instructions);

// Solves a quadratic program; returns 1, or 0 where it does not.
Index floatplan_quadratic(Quadratic *qp, Index instructions);

// Follows starts of so many problems, one after the other; returns 0, or 1 where there was no memory.
Index floatplan_attempt(const Robot *robot, const Constraints *constraints, const Motions *motions,
                        const Nodes *levels, const Settings *settings, const Exchange *exchange, const Powers *powers,
                        SearchProblem *problems, SamplingOptions *sampling, Index count, Index instructions);

// A program at one x; returns 0, or 1 where there was no memory for it.
Index floatplan_evaluate(const Robot *robot, const Constraints *constraints, const Motions *motions,
                         const Nodes *levels, const Settings *settings, const Exchange *exchange, SearchProblem *problem,
                         Evaluation *at, Index instructions);

// The same two of flights in space.
Index floatplan_attempt_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints,
                                 const Motions *motions, const Nodes *levels, const Settings *settings,
                                 const Exchange *exchange, const Powers *powers, SearchProblem *problems,
                                 SamplingOptions *sampling, Index count, Index instructions);
Index floatplan_evaluate_in_space(const SpatialBody *body, const Cells *cells, const Constraints *constraints,
                                  const Motions *motions, const Nodes *levels, const Settings *settings,
                                  const Exchange *exchange, SearchProblem *problem, Evaluation *at, Index instructions);

// A lifted motion of one; returns 0, 1 where that cannot be integrated, or 2 where there was no memory for it.
Index floatplan_lift(const SpatialBody *body, const Cells *cells, const Motions *motions, const Nodes *nodes,
                     Lifted *lifted, Index instructions);

// Momentum and torques of a tree in space; returns 0, or 1 where there was no memory for it.
Index floatplan_space(const SpatialTree *tree, const SpatialMotion *motion, Index instructions);

// Where its bodies are; returns 0, or 1 where there was no memory for it.
Index floatplan_poses(const SpatialTree *tree, const SpatialPoses *poses, Index instructions);

// Lowest points of solids; returns 0, or 1 where there was no memory for it.
Index floatplan_lowest(const PlacedSolids *solids, Index instructions);

// How far they reach on the ground; returns 0.
Index floatplan_reach(const PlacedSolids *solids, Index instructions);

// Positions of a limb's joints that bring it to where it is to be; returns 0, or 1 where there was no memory for it.
Index floatplan_bend(const SpatialTree *tree, const LimbTargets *targets, Index instructions);

// How the base of one turns; returns 0, 1 where that cannot be integrated, or 2 where there was no memory for it.
Index floatplan_turn(const Turning *turning, Index asked, Index instructions);

// Lower bounds of a sum of cosines on boxes; returns 0.
Index floatplan_bound(const Cosines *cosines, Index instructions);
