// K-means in the parametric space of a mode (Section 5.1 of the K-CTA paper): the first clusters.
#pragma once

#include <cstdint>
#include <vector>

#include "nacre/tensor.hpp"

namespace nacre {

// The cluster of each row of `points`, every cluster having at least one (clusters <= points).
// K-means++ seeds and Lloyd's iteration, the best of several restarts.
std::vector<Index> kmeans(const MatrixD& points, Index clusters, std::uint64_t seed);

}  // namespace nacre
