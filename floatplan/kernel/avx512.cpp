// The kernel for processors with AVX-512. A pragma switches them on, after all that is shared, and off again before
// templates are instantiated at the end: a flag of the compiler would have them in what runs on other processors too.
#include "common.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,avx512dq,avx512vl,fma"))), apply_to = function)
#else
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
