// What all sets of instructions share. It is included before any of them is switched on: what the compiler makes of it, and
// of the standard library's templates, runs on every processor, whichever of the equal copies the linker keeps.
#pragma once
extern "C" {
#include "kernel.h"
}

#include <algorithm>
#include <atomic>
#include <cmath>
#include <initializer_list>
#include <cstdint>
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

// Arrays one after the other in memory; without any, how much they take. Large ones are some lines of the cache further
// apart: of those whose sizes are powers of two all would begin in the same few sets of it, and throw one another out.
struct Arena {
    static constexpr std::size_t LINE = 64, LARGE = 16 * LINE, APART = 3 * LINE;  // bytes
    char *memory = nullptr;
    std::size_t used = 0;
    template <typename T> void take(T *&array, Index count) {
        if (memory) array = reinterpret_cast<T *>(memory + used);
        const std::size_t bytes = (count * sizeof(T) + LINE - 1) / LINE * LINE;
        used += bytes + (bytes < LARGE ? 0 : APART);
    }
    Index numbers() const { return used / sizeof(double) + 8; }  // some are left out, see aligned()
};

// In memory that Python gives, from where whole vectors may begin.
inline Arena aligned(double *memory) {
    return {reinterpret_cast<char *>((reinterpret_cast<std::uintptr_t>(memory) + 63) / 64 * 64)};
}

// Memory for one call, most of it never touched. The last block is kept for the next one: fresh pages cost 0.2 ms a
// search.
struct Workspace {
    static constexpr std::size_t HEAD = 64, MOST_KEPT = 1 << 26;  // bytes
    inline static std::atomic<std::size_t *> spare{nullptr};
    std::size_t *block = nullptr;  // it begins with its size

    // Memory for all that a function takes of an arena.
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
    ~Workspace() { std::free(block && *block <= MOST_KEPT ? spare.exchange(block) : block); }
};
