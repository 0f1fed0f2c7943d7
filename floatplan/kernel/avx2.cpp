// The kernel for processors with AVX2 and FMA. A pragma switches them on, after all that is shared, and off again before
// templates are instantiated at the end: a flag of the compiler would have them in what runs on other processors too.
#include "common.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
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
#else
#pragma GCC pop_options
#endif
#endif
