// From the state of a fit to the model that it hands out, and back.
#pragma once

#include <vector>

#include "cluster_state.hpp"
#include "nacre/clustered.hpp"

namespace nacre {

// modes: those of the model in the order of the state. A complete model has all its mixture
// clusters, also where the fit is still at hard clusters.
ClusteredTucker to_model(const ClusterState& state, const ClusteredOptions& options,
                         const std::vector<Index>& modes, const std::vector<MatrixF>& globals,
                         const std::vector<double>& errors, double energy, bool complete);

// Everything but the spread cores.
void from_model(const ClusteredTucker& model, const std::vector<Index>& modes, ClusterState& state);

// The tensor with its modes in this order.
Tensor permuted(const Tensor& tensor, const std::vector<Index>& order);

}  // namespace nacre
