#include "kernels.hpp"

#if defined(__x86_64__)

#include <immintrin.h>

namespace {

struct Vector {
    using Type = __m512;
    using Mask = __mmask16;
    static constexpr int kWidth = 16;
    static Type zero() { return _mm512_setzero_ps(); }
    static Type broadcast(float value) { return _mm512_set1_ps(value); }
    static Type load(const float* from) { return _mm512_loadu_ps(from); }
    static Type load(const float* from, Mask mask) { return _mm512_maskz_loadu_ps(mask, from); }
    static void store(float* to, Type value) { _mm512_storeu_ps(to, value); }
    static void store(float* to, Type value, Mask mask) { _mm512_mask_storeu_ps(to, mask, value); }
    static Type add(Type a, Type b) { return _mm512_add_ps(a, b); }
    static Type multiply_add(Type a, Type b, Type c) { return _mm512_fmadd_ps(a, b, c); }
    static Mask first(std::int64_t count) { return static_cast<Mask>((1u << count) - 1); }
    static __m256 folded(Type v) {
        const __m256 upper = _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(v), 1));
        return _mm256_add_ps(_mm512_castps512_ps256(v), upper);
    }
    // The sums of four vectors.
    static __m128 sums(Type a, Type b, Type c, Type d) {
        const __m256 pairs = _mm256_hadd_ps(_mm256_hadd_ps(folded(a), folded(b)),
                                            _mm256_hadd_ps(folded(c), folded(d)));
        return _mm_add_ps(_mm256_castps256_ps128(pairs), _mm256_extractf128_ps(pairs, 1));
    }
    static float sum(Type v) { return _mm512_reduce_add_ps(v); }
};

}  // namespace

// What fits in 32 registers.
#define NACRE_PRODUCT_ROWS 14
#define NACRE_INNER_ROWS 6
#define NACRE_ROWS_VECTORS 4
#include "kernels.inl"

const nacre::Kernels nacre::kKernelsAvx512{product, gram, inner, rows};

#endif
