// Interleaved half or float samples to planar floats.
#pragma once

#include <cstdint>

#include "nacre/source.hpp"

namespace nacre {

float half_to_float(std::uint16_t half);

// Takes `pixels` pixels of `channels` interleaved values, from value number `first` of `samples`
// on, to planar rows: planes[channel * plane_stride + pixel]. Exact.
void unpack(const void* samples, SampleType type, Index first, Index pixels, Index channels,
            float* planes, Index plane_stride);

}  // namespace nacre
