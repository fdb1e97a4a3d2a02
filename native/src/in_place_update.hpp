// The decomposition of a cluster whose part of the residual is read where it lies, and never
// copied: where the bases are those of several clustered modes and no others, as in MK-CTA with
// global ones, or where one mode is clustered, as in K-CTA.
#pragma once

#include "block_decomposition.hpp"
#include "cluster_state.hpp"
#include "nacre/executor.hpp"

namespace nacre {

// Whether the clusters of this state are of one of these kinds.
bool can_update_in_place(const ClusterState& state);

// Memory that the clusters one after the other use.
struct ResidualScratch {
    Tensor old_core, core, rest, other;
    BlockDecomposition decomposition;
};

// One sweep of alternating least squares for cluster c, from its present bases, which need not be
// orthonormal. `residual` is the tensor less its approximation, and stays so.
void update_in_place(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch);

// The two kinds of update_in_place.
void update_one_mode(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch);
void update_several_modes(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                          ResidualScratch& scratch);

}  // namespace nacre
