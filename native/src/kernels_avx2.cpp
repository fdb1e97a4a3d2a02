#include "kernels.hpp"

#if defined(__x86_64__)

#include <immintrin.h>

namespace {

struct Vector {
    using Type = __m256;
    using Mask = __m256i;
    static constexpr int kWidth = 8;
    static Type zero() { return _mm256_setzero_ps(); }
    static Type broadcast(float value) { return _mm256_set1_ps(value); }
    static Type load(const float* from) { return _mm256_loadu_ps(from); }
    static Type load(const float* from, Mask mask) { return _mm256_maskload_ps(from, mask); }
    static void store(float* to, Type value) { _mm256_storeu_ps(to, value); }
    static void store(float* to, Type value, Mask mask) { _mm256_maskstore_ps(to, mask, value); }
    static Type add(Type a, Type b) { return _mm256_add_ps(a, b); }
    static Type multiply_add(Type a, Type b, Type c) { return _mm256_fmadd_ps(a, b, c); }
    static Mask first(std::int64_t count) {
        const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        return _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(count)), lanes);
    }
    // The sums of four vectors.
    static __m128 sums(Type a, Type b, Type c, Type d) {
        const __m256 pairs = _mm256_hadd_ps(_mm256_hadd_ps(a, b), _mm256_hadd_ps(c, d));
        return _mm_add_ps(_mm256_castps256_ps128(pairs), _mm256_extractf128_ps(pairs, 1));
    }
    static float sum(Type v) {
        __m128 half = _mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
        half = _mm_add_ps(half, _mm_movehl_ps(half, half));
        return _mm_cvtss_f32(_mm_add_ss(half, _mm_movehdup_ps(half)));
    }
};

}  // namespace

// What fits in 16 registers.
#define NACRE_PRODUCT_ROWS 6
#define NACRE_INNER_ROWS 3
#define NACRE_ROWS_VECTORS 2
#include "kernels.inl"

const nacre::Kernels nacre::kKernelsAvx2{product, gram, inner, rows};

#endif
