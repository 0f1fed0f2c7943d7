// The kernel for what every processor of its kind has.
#include "common.hpp"

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
