#include "table_kernel.hpp"

namespace nacre {

namespace {

// Two quads side by side, as two registers where the processor has shorter ones.
using Quad [[gnu::vector_size(16), gnu::aligned(4), gnu::may_alias]] = float;
using Lanes [[gnu::vector_size(32), gnu::aligned(4), gnu::may_alias]] = float;

#define NACRE_INLINE inline __attribute__((always_inline))

// Vectors go through references: as values they would have another calling convention for each
// processor.
NACRE_INLINE void load(const float* from, Lanes& lanes) {
    lanes = *reinterpret_cast<const Lanes*>(from);
}

NACRE_INLINE void load(const float* left, const float* right, Lanes& lanes) {
    const Quad a = *reinterpret_cast<const Quad*>(left), b = *reinterpret_cast<const Quad*>(right);
    lanes = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
}

// Sums of neighbours, within each half: the order that processors have an instruction for.
NACRE_INLINE void add_pairs(const Lanes& a, const Lanes& b, Lanes& sums) {
    sums = __builtin_shufflevector(a, b, 0, 2, 8, 10, 4, 6, 12, 14) +
           __builtin_shufflevector(a, b, 1, 3, 9, 11, 5, 7, 13, 15);
}

NACRE_INLINE void quads_all(const QuadSums& sums) {
    Index t = 0;
    for (; t + 8 <= sums.texels; t += 8) {
        Lanes total[4] = {};
        for (Index d = 0; d < sums.depth; ++d) {
            Lanes row;
            load(sums.rows + 4 * d, sums.rows + 4 * d, row);
            const float* quads = sums.planes[d] + 4 * t;
            for (int i = 0; i < 4; ++i) {
                Lanes two;
                load(quads + 8 * i, two);
                total[i] += two * row;
            }
        }
        Lanes first, second, both;
        add_pairs(total[0], total[1], first);
        add_pairs(total[2], total[3], second);
        add_pairs(first, second, both);  // texels 0, 2, 4, 6, 1, 3, 5, 7
        *reinterpret_cast<Lanes*>(sums.out + t) =
            __builtin_shufflevector(both, both, 0, 4, 1, 5, 2, 6, 3, 7);
    }
    for (; t < sums.texels; ++t) {
        Quad total = {};
        for (Index d = 0; d < sums.depth; ++d) {
            total += *reinterpret_cast<const Quad*>(sums.planes[d] + 4 * t) *
                     *reinterpret_cast<const Quad*>(sums.rows + 4 * d);
        }
        sums.out[t] = (total[0] + total[1]) + (total[2] + total[3]);
    }
}

// kRanks planes of the light's rank `quad`: each one's four taps with the view's row, in lanes,
// then times the light. Lanes are only added up when all is summed.
template <int kRanks, int kChannels>
NACRE_INLINE void points_quad(const PointSums& sums, Index quad) {
    for (Index p = 0; p < sums.count; ++p) {
        const PointSums::Point& point = sums.points[p];
        const float* rows = sums.rows + p * sums.view_quads * 2 * kPointLanes;
        const float* core = point.core + 4 * quad * sums.view_quads * sums.plane;
        Lanes reduced[kRanks] = {};
        for (Index q = 0; q < sums.view_quads; ++q, rows += 2 * kPointLanes) {
            Lanes low, high;
            load(rows, low);
            load(rows + kPointLanes, high);
            for (int r = 0; r < kRanks; ++r) {
                const float* plane = core + (r * sums.view_quads + q) * sums.plane;
                Lanes texels;
                load(plane + point.taps[0], plane + point.taps[1], texels);
                reduced[r] += texels * low;
                load(plane + point.taps[2], plane + point.taps[3], texels);
                reduced[r] += texels * high;
            }
        }
        const float* light = point.light + quad * sums.quad_stride;
        float* totals = sums.totals + p * kChannels * kPointLanes;
        for (int c = 0; c < kChannels; ++c, light += sums.channel_stride, totals += kPointLanes) {
            Lanes total;
            load(totals, total);
            for (int r = 0; r < kRanks; ++r) total += reduced[r] * light[r];
            *reinterpret_cast<Lanes*>(totals) = total;
        }
    }
}

template <int kChannels>
NACRE_INLINE void points_of(const PointSums& sums) {
    Index rank = 0;
    for (; rank + 4 <= sums.light_rank; rank += 4) points_quad<4, kChannels>(sums, rank / 4);
    switch (sums.light_rank - rank) {
        case 3:
            return points_quad<3, kChannels>(sums, rank / 4);
        case 2:
            return points_quad<2, kChannels>(sums, rank / 4);
        case 1:
            return points_quad<1, kChannels>(sums, rank / 4);
    }
}

NACRE_INLINE void points_all(const PointSums& sums) {
    if (sums.channels == 1) return points_of<1>(sums);
    if (sums.channels == 2) return points_of<2>(sums);
    points_of<3>(sums);
}

void plain_quads(const QuadSums& sums) { quads_all(sums); }
void plain_points(const PointSums& sums) { points_all(sums); }
constexpr TableKernel kPlain{plain_quads, plain_points};

#if defined(__x86_64__)

__attribute__((target("avx2,fma"))) void fused_quads(const QuadSums& sums) { quads_all(sums); }
__attribute__((target("avx2,fma"))) void fused_points(const PointSums& sums) { points_all(sums); }
constexpr TableKernel kFused{fused_quads, fused_points};

bool has_fma() {
    static const bool result = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    return result;
}

#endif

}  // namespace

const TableKernel& table_kernel([[maybe_unused]] bool portable) {
#if defined(__x86_64__)
    if (!portable && has_fma()) return kFused;
#endif
    return kPlain;
}

}  // namespace nacre
