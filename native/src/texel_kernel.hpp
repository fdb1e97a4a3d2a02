// The inner loop of Evaluator: weighted sums over a few blocks of each texel's record.
#pragma once

#include "nacre/tensor.hpp"

namespace nacre {

inline constexpr Index kLanes = 8;  // floats that are worked on at once
inline constexpr Index kGroup = 3;  // channels at most that one call sums

struct TexelSums {
    const float* texture;  // records of texels
    Index record;          // floats of a record
    const Index* texels;
    Index count;
    const Index* blocks;  // where in a record each block begins
    Index block_count;
    Index floats;          // of a block, whole lanes
    const float* weights;  // for each block and each of its lanes: lanes of channel 0, 1, ...
    float* out;            // out[i * out_stride + channel]
    Index out_stride;
};

using TexelKernel = void (*)(const TexelSums&);

// The fastest kernel that this processor runs, for 1 to kGroup channels; or the one for any.
TexelKernel texel_kernel(int channels, bool portable = false);

}  // namespace nacre
