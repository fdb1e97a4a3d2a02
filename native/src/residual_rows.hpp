// The decomposition of a cluster whose only bases are those of its clustered modes, of which there
// are several: its part of the residual is read where it lies, and never copied.
#pragma once

#include "cluster_state.hpp"
#include "nacre/executor.hpp"

namespace nacre {

// Whether the clusters of this state are of that kind.
bool has_clustered_bases_alone(const ClusterState& state);

// Memory that the clusters one after the other use.
struct ResidualScratch {
    Tensor old_core, core, rest, other;
};

// One sweep of alternating least squares for cluster c, from its present bases, which need not be
// orthonormal. `residual` is the tensor less its approximation, and stays so.
void update_in_place(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch);

}  // namespace nacre
