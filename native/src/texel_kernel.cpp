#include "texel_kernel.hpp"

#include <algorithm>

namespace nacre {

namespace {

constexpr Index kLine = 16;   // floats of a cache line
constexpr Index kAhead = 8;   // texels between the one being summed and the one being fetched
constexpr Index kTexels = 4;  // texels summed together: they share the weights' loads

// Eight floats, as two or four registers where the processor has shorter ones.
using Lanes [[gnu::vector_size(32), gnu::aligned(4), gnu::may_alias]] = float;

#define NACRE_INLINE inline __attribute__((always_inline))

NACRE_INLINE void load(const float* from, Lanes& lanes) {
    lanes = *reinterpret_cast<const Lanes*>(from);
}

// Texels are far apart in memory: without this, each would wait for its blocks in turn.
NACRE_INLINE void fetch(const TexelSums& sums, Index texel) {
    const float* record = sums.texture + texel * sums.record;
    for (Index b = 0; b < sums.block_count; ++b) {
        const float* block = record + sums.blocks[b];
        for (Index i = 0; i < sums.floats; i += kLine) __builtin_prefetch(block + i);
    }
}

template <int kCount, int kChannels>
NACRE_INLINE void sum(const TexelSums& sums, Index first) {
    Lanes total[kCount][kChannels] = {};
    const float* record[kCount];
    for (int t = 0; t < kCount; ++t) {
        record[t] = sums.texture + sums.texels[first + t] * sums.record;
    }
    const float* weights = sums.weights;
    for (Index b = 0; b < sums.block_count; ++b) {
        const Index begin = sums.blocks[b];
        for (Index i = begin; i < begin + sums.floats; i += kLanes, weights += kChannels * kLanes) {
            Lanes weight[kChannels];
            for (int c = 0; c < kChannels; ++c) load(weights + c * kLanes, weight[c]);
            for (int t = 0; t < kCount; ++t) {
                Lanes core;
                load(record[t] + i, core);
                for (int c = 0; c < kChannels; ++c) total[t][c] += core * weight[c];
            }
        }
    }
    for (int t = 0; t < kCount; ++t) {
        for (int c = 0; c < kChannels; ++c) {
            const Lanes& v = total[t][c];
            sums.out[(first + t) * sums.out_stride + c] =
                ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
        }
    }
}

template <int kChannels>
NACRE_INLINE void sum_all(const TexelSums& sums) {
    for (Index i = 0; i < std::min(kAhead, sums.count); ++i) fetch(sums, sums.texels[i]);
    Index i = 0;
    for (; i + kTexels <= sums.count; i += kTexels) {
        const Index end = std::min(i + kAhead + kTexels, sums.count);
        for (Index next = i + kAhead; next < end; ++next) fetch(sums, sums.texels[next]);
        sum<kTexels, kChannels>(sums, i);
    }
    for (; i < sums.count; ++i) sum<1, kChannels>(sums, i);
}

template <int kChannels>
void plain(const TexelSums& sums) {
    sum_all<kChannels>(sums);
}

#if defined(__x86_64__)

template <int kChannels>
__attribute__((target("avx2,fma"))) void fused(const TexelSums& sums) {
    sum_all<kChannels>(sums);
}

bool has_fma() {
    static const bool result = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    return result;
}

#endif

}  // namespace

TexelKernel texel_kernel(int channels, [[maybe_unused]] bool portable) {
#if defined(__x86_64__)
    if (!portable && has_fma())
        return channels == 1 ? fused<1> : channels == 2 ? fused<2> : fused<3>;
#endif
    return channels == 1 ? plain<1> : channels == 2 ? plain<2> : plain<3>;
}

}  // namespace nacre
