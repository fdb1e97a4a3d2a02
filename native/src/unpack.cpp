#include "nacre/unpack.hpp"

#include <bit>

#if defined(__x86_64__)
#include <immintrin.h>
#define NACRE_F16C __attribute__((target("avx2,f16c")))
#endif

namespace nacre {

float half_to_float(std::uint16_t half) {
    const std::uint32_t sign = static_cast<std::uint32_t>(half & 0x8000u) << 16;
    const std::uint32_t magnitude = half & 0x7fffu;
    if (magnitude >= 0x7c00u) {  // infinity and NaN
        return std::bit_cast<float>(sign | 0x7f800000u | (magnitude & 0x3ffu) << 13);
    }
    // Shifting the bits to their place leaves the exponent short by 112; the product puts it right
    // and normalises subnormal numbers on the way.
    const float value = std::bit_cast<float>(magnitude << 13) * 0x1p112f;
    return std::bit_cast<float>(sign | std::bit_cast<std::uint32_t>(value));
}

namespace {

float load(const std::uint16_t* p) { return half_to_float(*p); }
float load(const float* p) { return *p; }

template <class Sample>
void unpack_any(const Sample* from, Index pixels, Index channels, float* planes, Index stride,
                Index done = 0) {
    for (Index p = done; p < pixels; ++p) {
        for (Index c = 0; c < channels; ++c) planes[c * stride + p] = load(from + p * channels + c);
    }
}

#if defined(__x86_64__)

NACRE_F16C inline __m256 load8(const std::uint16_t* p) {
    return _mm256_cvtph_ps(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
}
NACRE_F16C inline __m256 load8(const float* p) { return _mm256_loadu_ps(p); }

// Samples so many bytes further on are asked for: a block is made of runs of a few thousand bytes
// from all over the tensor, each too short for the processor to guess.
constexpr Index kAhead = 4096;

template <class Sample>
void prefetch(const Sample* from) {
    __builtin_prefetch(reinterpret_cast<const char*>(from) + kAhead);
}

// Eight pixels at a time; returns how many are done.
template <class Sample>
NACRE_F16C Index unpack_1(const Sample* from, Index pixels, float* plane) {
    Index p = 0;
    for (; p + 8 <= pixels; p += 8) {
        prefetch(from + p);
        _mm256_storeu_ps(plane + p, load8(from + p));
    }
    return p;
}

template <class Sample>
NACRE_F16C Index unpack_3(const Sample* from, Index pixels, float* planes, Index stride) {
    // a, b, c hold r0 g0 b0 r1 g1 b1 r2 g2 | b2 r3 ... r5 | g5 ... b7. Each colour has three, three
    // and two of its eight in them at lanes that never collide: blend, then put in order.
    const __m256i order_r = _mm256_setr_epi32(0, 3, 6, 1, 4, 7, 2, 5);
    const __m256i order_g = _mm256_setr_epi32(1, 4, 7, 2, 5, 0, 3, 6);
    const __m256i order_b = _mm256_setr_epi32(2, 5, 0, 3, 6, 1, 4, 7);
    Index p = 0;
    for (; p + 8 <= pixels; p += 8) {
        prefetch(from + 3 * p);
        const __m256 a = load8(from + 3 * p);
        const __m256 b = load8(from + 3 * p + 8);
        const __m256 c = load8(from + 3 * p + 16);
        constexpr int k036 = 0b01001001, k147 = 0b10010010, k25 = 0b00100100;
        const __m256 r = _mm256_blend_ps(_mm256_blend_ps(a, b, k147), c, k25);
        const __m256 g = _mm256_blend_ps(_mm256_blend_ps(a, b, k25), c, k036);
        const __m256 l = _mm256_blend_ps(_mm256_blend_ps(a, b, k036), c, k147);
        _mm256_storeu_ps(planes + p, _mm256_permutevar8x32_ps(r, order_r));
        _mm256_storeu_ps(planes + stride + p, _mm256_permutevar8x32_ps(g, order_g));
        _mm256_storeu_ps(planes + 2 * stride + p, _mm256_permutevar8x32_ps(l, order_b));
    }
    return p;
}

bool has_f16c() {
    static const bool result = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("f16c");
    return result;
}

#endif

template <class Sample>
void unpack_as(const Sample* from, Index pixels, Index channels, float* planes, Index stride) {
    Index done = 0;
#if defined(__x86_64__)
    if (has_f16c()) {
        if (channels == 1) done = unpack_1(from, pixels, planes);
        if (channels == 3) done = unpack_3(from, pixels, planes, stride);
    }
#endif
    unpack_any(from, pixels, channels, planes, stride, done);
}

}  // namespace

void unpack(const void* samples, SampleType type, Index first, Index pixels, Index channels,
            float* planes, Index plane_stride) {
    if (type == SampleType::kHalf) {
        unpack_as(static_cast<const std::uint16_t*>(samples) + first, pixels, channels, planes,
                  plane_stride);
    } else {
        unpack_as(static_cast<const float*>(samples) + first, pixels, channels, planes,
                  plane_stride);
    }
}

}  // namespace nacre
