// The inner loops of TableEvaluator, over the rank quads where they lie.
#pragma once

#include "nacre/tensor.hpp"

namespace nacre {

// out[t] = sum over d of the dot product of quad t of planes[d] and rows[4 d .. 4 d + 3].
struct QuadSums {
    const float* const* planes;
    const float* rows;
    Index depth;
    Index texels;
    float* out;
};

inline constexpr Index kPointChannels = 3;  // at most, that one call sums
inline constexpr Index kPointLanes = 8;     // in which a point's sum is kept, to be added up

// Points in steps of one quad of the light's ranks, for all points of a block one after the other:
// neighbours on the patch then read the same lines of a plane, while those of different planes
// would compete for the same places of a cache.
struct PointSums {
    struct Point {
        const float* core;   // the first plane of the point's clusters
        const float* light;  // the light's rows, at its texel
        Index taps[4];       // floats into a plane: (y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)
    };
    const Point* points;
    Index count;
    const float* rows;  // of each point: view_quads x 2 rows of taps x (4 left, 4 right) lanes
    Index light_rank, view_quads, plane;
    Index channels, channel_stride;  // floats between channels of the light's rows
    Index quad_stride;               // floats between their quads
    float* totals;                   // points x channels x lanes, added to
};

struct TableKernel {
    void (*quads)(const QuadSums&);
    void (*points)(const PointSums&);
};

// The fastest that this processor runs; or the one for any.
const TableKernel& table_kernel(bool portable = false);

}  // namespace nacre
