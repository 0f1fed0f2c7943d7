// Plans without inequalities, compiled: batches of problems of one robot, one after the other.
//
// What all.hpp includes is compiled for each set of instructions; which one runs is chosen when the library is called.
// Nothing here relies on unsafe floating-point transformations: compile with -ffp-contract=off.
#include "kernel.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <initializer_list>
#include <cstdlib>
#include <cstring>
#include <new>
#include <utility>

#define INLINED __attribute__((always_inline)) static inline

namespace {

constexpr int MOST_COLUMNS = 32;  // degree + 1

// ---- random numbers: SplitMix64 (Steele, Lea and Flood 2014), normal ones by Box and Muller

struct Random {
    std::uint64_t state;

    std::uint64_t next() {
        std::uint64_t z = state += 0x9e3779b97f4a7c15u;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return z ^ (z >> 31);
    }
    double uniform() { return (next() >> 11) * 0x1p-53 + 0x1p-54; }
    double normal() {
        double length = std::sqrt(-2 * std::log(uniform()));
        return length * std::cos(6.283185307179586 * uniform());
    }
};

}  // namespace

// ---- memory

// Arrays one after the other in memory; without any, how much they take.
struct Arena {
    char *memory = nullptr;
    std::size_t used = 0;
    template <typename T> void take(T *&array, Index count) {
        if (memory) array = reinterpret_cast<T *>(memory + used);
        used += (count * sizeof(T) + 63) / 64 * 64;
    }
    Index numbers() const { return used / sizeof(double) + 8; }  // some are left out, see aligned()
};

// In memory that Python gives, from where whole vectors may begin.
inline Arena aligned(double *memory) {
    return {reinterpret_cast<char *>((reinterpret_cast<std::uintptr_t>(memory) + 63) / 64 * 64)};
}

// Memory for one call, most of it never touched. The last block is kept for the next one: fresh pages cost 0.2 ms a
// search.
struct Room {
    static constexpr std::size_t HEAD = 64, MOST_KEPT = 1 << 26;  // bytes
    inline static std::atomic<std::size_t *> spare{nullptr};
    std::size_t *block = nullptr;  // it begins with its size

    // Room for what a function takes of an arena.
    template <typename LayOut> bool make(LayOut lay_out) {
        Arena measure{nullptr, HEAD};
        lay_out(measure);
        block = spare.exchange(nullptr);
        if (!block || *block < measure.used) {
            std::free(std::exchange(block, nullptr));
            void *memory;
            if (posix_memalign(&memory, HEAD, measure.used) != 0) return false;
            block = new (memory) std::size_t(measure.used);
        }
        Arena arena{reinterpret_cast<char *>(block), HEAD};
        lay_out(arena);
        return true;
    }
    ~Room() { std::free(block && *block <= MOST_KEPT ? spare.exchange(block) : block); }
};

// ---- the planner for each set of instructions

namespace baseline {
constexpr int LANES = 2;
#if defined(__aarch64__)
constexpr bool FUSED = true;  // whether products and sums are rounded once
#else
constexpr bool FUSED = false;
#endif
typedef double Vector __attribute__((vector_size(16)));
typedef Index Bits __attribute__((vector_size(16)));
static inline Vector all(double value) { return Vector{value, value}; }
static inline Vector multiply_add(Vector a, Vector b, Vector c) {
#if defined(__aarch64__) && defined(__clang__)
    return __builtin_elementwise_fma(a, b, c);
#elif defined(__aarch64__)
    return Vector{__builtin_fma(a[0], b[0], c[0]), __builtin_fma(a[1], b[1], c[1])};
#else
    return a * b + c;
#endif
}
static inline Vector square_root(Vector a) { return Vector{std::sqrt(a[0]), std::sqrt(a[1])}; }
static inline bool any(Bits mask) { return mask[0] | mask[1]; }
#include "all.hpp"
}  // namespace baseline

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#define FLOATPLAN_X86
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#endif
namespace avx2 {
constexpr int LANES = 4;
constexpr bool FUSED = true;
typedef double Vector __attribute__((vector_size(32)));
typedef Index Bits __attribute__((vector_size(32)));
static inline Vector all(double value) { return (Vector)_mm256_set1_pd(value); }
static inline Vector multiply_add(Vector a, Vector b, Vector c) {
    return (Vector)_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c);
}
static inline Vector square_root(Vector a) { return (Vector)_mm256_sqrt_pd((__m256d)a); }
static inline bool any(Bits mask) { return !_mm256_testz_si256((__m256i)mask, (__m256i)mask); }
#include "all.hpp"
}  // namespace avx2
#if defined(__clang__)
#pragma clang attribute pop
#pragma clang attribute push(__attribute__((target("avx512f,avx512dq,avx512vl,fma"))), apply_to = function)
#else
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,fma")
#endif
namespace avx512 {
constexpr int LANES = 8;
constexpr bool FUSED = true;
typedef double Vector __attribute__((vector_size(64)));
typedef Index Bits __attribute__((vector_size(64)));
static inline Vector all(double value) { return (Vector)_mm512_set1_pd(value); }
static inline Vector multiply_add(Vector a, Vector b, Vector c) {
    return (Vector)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c);
}
static inline Vector square_root(Vector a) { return (Vector)_mm512_sqrt_pd((__m512d)a); }
static inline bool any(Bits mask) { return _mm512_test_epi64_mask((__m512i)mask, (__m512i)mask); }
#include "all.hpp"
}  // namespace avx512
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

#ifndef FLOATPLAN_SOURCES
#define FLOATPLAN_SOURCES ""
#endif
#define EXPORT extern "C" __attribute__((visibility("default")))

EXPORT const char *floatplan_sources() { return FLOATPLAN_SOURCES; }

// The widest set of instructions that this processor has and its system keeps: 0 the baseline, 1 AVX2 with FMA,
// 2 AVX-512.
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

// Plans a batch; returns 0, or 1 where there was no memory for it.
EXPORT Index floatplan_plan(const Robot *robot, const Grid *grids, const Index *nodes,
                                   const Powers *powers, const Settings *settings, Batch *batch,
                                   Index instructions) {
    return CHOSEN(plan_batch(*robot, grids, nodes, *powers, *settings, *batch));
}

// Measures a batch of plans, their distances to obstacles where there are constraints; returns 0, or 1 where there was no memory for it.
EXPORT Index floatplan_peaks(const Robot *robot, const Interpolation *interpolations, const Constraints *constraints,
                             Peaks *peaks, Index instructions) {
    return CHOSEN(measure_batch(*robot, interpolations, constraints, *peaks));
}

// How many numbers an update of a flight's corrections works in.
EXPORT Index floatplan_flight_room(const Robot *robot, const Constraints *constraints, Flight *flight) {
    return baseline::FlightUpdate(*robot, *constraints, *flight, nullptr).room();
}

// One step of an update of a flight's corrections.
EXPORT void floatplan_flight(const Robot *robot, const Constraints *constraints, Flight *flight, Index step,
                             Index instructions) {
    CHOSEN(update_flight(*robot, *constraints, *flight, step));
}

// Solves a quadratic program; returns 1, or 0 where it does not.
EXPORT Index floatplan_quadratic(Quadratic *qp, Index instructions) {
    return CHOSEN(solve_quadratic(*qp));
}

// Follows starts of so many problems with constraints, one after the other; returns 0, or 1 where there was no memory.
EXPORT Index floatplan_attempt(const Robot *robot, const Constraints *constraints, const Motions *motions,
                               const Nodes *levels, const Settings *settings, const Exchange *rules,
                               const Powers *powers, Attempt *attempts, Draws *draws, Index count,
                               Index instructions) {
    return CHOSEN(follow_rows(*robot, constraints, motions, levels, *settings, *rules, powers, attempts, draws, count));
}

// A program at one x; returns 0, or 1 where there was no memory for it.
EXPORT Index floatplan_evaluate(const Robot *robot, const Constraints *constraints, const Motions *motions,
                                const Nodes *levels, const Settings *settings, const Exchange *rules,
                                Attempt *attempt, Evaluation *at, Index instructions) {
    return CHOSEN(evaluate_program(*robot, *constraints, *motions, levels, *settings, *rules, *attempt, *at));
}

// Momentum and torques of a tree in space; returns 0, or 1 where there was no memory for it.
EXPORT Index floatplan_space(const SpatialTree *tree, const SpatialMotion *motion, Index instructions) {
    return CHOSEN(move_in_space(*tree, *motion));
}

// How the base of one turns; returns 0, 1 where that cannot be integrated, or 2 where there was no memory for it.
EXPORT Index floatplan_turn(const Turning *turning, Index asked, Index instructions) {
    return CHOSEN(turn_in_space(*turning, static_cast<Asked>(asked)));
}

// Lower bounds of a sum of cosines on boxes.
EXPORT Index floatplan_bound(const Cosines *cosines, Index instructions) {
    return CHOSEN(bound_boxes(*cosines));
}
