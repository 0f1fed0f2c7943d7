// The functions of the library: each asks for itself as compiled for the widest set of instructions of this processor.
//
// The sets are compiled one beside the other, from baseline.cpp, avx2.cpp and avx512.cpp.
// Nothing here relies on unsafe floating-point transformations: compile with -ffp-contract=off.
extern "C" {
#include "kernel.h"
}

namespace baseline {
#include "entries.hpp"
}
#if defined(__x86_64__)
#include <cpuid.h>
#define FLOATPLAN_X86
namespace avx2 {
#include "entries.hpp"
}
namespace avx512 {
#include "entries.hpp"
}
#endif

#ifndef FLOATPLAN_SOURCES
#define FLOATPLAN_SOURCES ""
#endif
#ifndef FLOATPLAN_BUILD
#define FLOATPLAN_BUILD ""
#endif
#define EXPORT extern "C" __attribute__((visibility("default")))

// build.py writes and reads both.
EXPORT const char *floatplan_sources() { return FLOATPLAN_SOURCES; }
EXPORT const char *floatplan_build() { return FLOATPLAN_BUILD; }

// Asked of the processor itself: what __builtin_cpu_supports() reads is not in every compiler's library.
EXPORT Index floatplan_instructions() {
#ifdef FLOATPLAN_X86
    constexpr unsigned fma_xsave_avx = 1u << 12 | 1u << 27 | 1u << 28, avx2 = 1u << 5;
    constexpr unsigned avx512_f_dq_vl = 1u << 16 | 1u << 17 | 1u << 31, wide = 0x6, widest = 0xe6;  // registers kept
    unsigned a, b, c, d, kept, above;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & fma_xsave_avx) != fma_xsave_avx) return 0;
    __asm__("xgetbv" : "=a"(kept), "=d"(above) : "c"(0));
    if ((kept & wide) != wide || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & avx2)) return 0;
    return (kept & widest) == widest && (b & avx512_f_dq_vl) == avx512_f_dq_vl ? 2 : 1;
#else
    return 0;
#endif
}

// A function as compiled for one of these sets.
#ifdef FLOATPLAN_X86
#define CHOSEN(call) (instructions == 2 ? avx512::call : instructions == 1 ? avx2::call : baseline::call)
#else
#define CHOSEN(call) ((void)instructions, baseline::call)
#endif

EXPORT Index floatplan_peaks(const Robot *robot, const Interpolation *interpolations, const Constraints *constraints,
                             Peaks *peaks, Index instructions) {
    return CHOSEN(measure_batch(*robot, interpolations, constraints, *peaks));
}

EXPORT Index floatplan_flight_room(const Robot *robot, const Constraints *constraints, CorrectedFlight *flight,
                                   Index instructions) {
    return CHOSEN(flight_room(*robot, *constraints, *flight));
}

EXPORT void floatplan_flight(const Robot *robot, const Constraints *constraints, CorrectedFlight *flight, Index step,
                             Index instructions) {
    CHOSEN(update_flight(*robot, *constraints, *flight, step));
}

EXPORT Index floatplan_flight_room_in_space(const SpatialBody *robot, const Constraints *constraints, CorrectedFlight *flight,
                                            Index instructions) {
    return CHOSEN(flight_room_in_space(*robot, *constraints, *flight));
}

EXPORT void floatplan_flight_in_space(const SpatialBody *robot, const Constraints *constraints, CorrectedFlight *flight, Index step,
                                      Index instructions) {
    CHOSEN(update_flight_in_space(*robot, *constraints, *flight, step));
}

EXPORT Index floatplan_quadratic(Quadratic *qp, Index instructions) {
    return CHOSEN(solve_quadratic(*qp));
}

EXPORT Index floatplan_attempt(const Robot *robot, const Constraints *constraints, const Motions *motions,
                               const Nodes *levels, const Settings *settings, const Exchange *exchange,
                               const Powers *powers, SearchProblem *problems, SamplingOptions *sampling, Index count,
                               Index instructions) {
    return CHOSEN(follow_rows(*robot, constraints, motions, levels, *settings, *exchange, powers, problems, sampling, count));
}

EXPORT Index floatplan_evaluate(const Robot *robot, const Constraints *constraints, const Motions *motions,
                                const Nodes *levels, const Settings *settings, const Exchange *exchange,
                                SearchProblem *problem, Evaluation *at, Index instructions) {
    return CHOSEN(evaluate_program(*robot, *constraints, *motions, levels, *settings, *exchange, *problem, *at));
}

EXPORT Index floatplan_attempt_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints,
                                        const Motions *motions, const Nodes *levels, const Settings *settings,
                                        const Exchange *exchange, const Powers *powers, SearchProblem *problems,
                                        SamplingOptions *sampling, Index count, Index instructions) {
    return CHOSEN(follow_in_space(bodies, cells, constraints, motions, levels, *settings, *exchange, powers, problems, sampling,
                                  count));
}

EXPORT Index floatplan_evaluate_in_space(const SpatialBody *body, const Cells *cells, const Constraints *constraints,
                                         const Motions *motions, const Nodes *levels, const Settings *settings,
                                         const Exchange *exchange, SearchProblem *problem, Evaluation *at, Index instructions) {
    return CHOSEN(evaluate_in_space(*body, cells, *constraints, *motions, levels, *settings, *exchange, *problem, *at));
}

EXPORT Index floatplan_lift(const SpatialBody *body, const Cells *cells, const Motions *motions, const Nodes *nodes,
                            Lifted *lifted, Index instructions) {
    return CHOSEN(lift_motion(*body, *cells, *motions, *nodes, *lifted));
}

EXPORT Index floatplan_space(const SpatialTree *tree, const SpatialMotion *motion, Index instructions) {
    return CHOSEN(move_in_space(*tree, *motion));
}

EXPORT Index floatplan_poses(const SpatialTree *tree, const SpatialPoses *poses, Index instructions) {
    return CHOSEN(place_bodies(*tree, *poses));
}

EXPORT Index floatplan_lowest(const PlacedSolids *solids, Index instructions) {
    return CHOSEN(lowest_points(*solids));
}

EXPORT Index floatplan_reach(const PlacedSolids *solids, Index instructions) {
    return CHOSEN(reach_on_ground(*solids));
}

EXPORT Index floatplan_bend(const SpatialTree *tree, const LimbTargets *targets, Index instructions) {
    return CHOSEN(bend_limb(*tree, *targets));
}

EXPORT Index floatplan_turn(const Turning *turning, Index asked, Index instructions) {
    return CHOSEN(turn_in_space(*turning, static_cast<Asked>(asked)));
}

EXPORT Index floatplan_bound(const Cosines *cosines, Index instructions) {
    return CHOSEN(bound_boxes(*cosines));
}
