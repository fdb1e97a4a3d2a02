// The decomposition stage (MK-CTA, Section 3.6; the update stage of K-CTA, Section 4.3): core and
// bases of one cluster after the other from what the others leave over, by N-SVD.
#pragma once

#include <memory>
#include <vector>

#include "cluster_state.hpp"
#include "nacre/executor.hpp"
#include "nacre/workspace.hpp"

namespace nacre {

class DecompositionStage {
  public:
    DecompositionStage(Executor& executor, const Workspace& workspace, ClusterState& state);
    ~DecompositionStage();

    // Updates every cluster. `residual` is the tensor less its approximation, and stays so.
    // sweeps: of alternating least squares in each cluster. Clusters without a basis yet start from
    // their truncated HOSVD, the approximation counting as zero.
    void run(Tensor& residual, int sweeps);

  private:
    class Cluster;
    void update(Executor& executor, Cluster& scratch, Tensor& residual, Index c, int sweeps);

    Executor& executor_;
    const Workspace& workspace_;
    ClusterState& state_;
    std::vector<std::unique_ptr<Cluster>> scratch_;  // one for each thread
};

// Fills in the spread of a cluster from its core and the bases of its unclustered modes.
void spread_core(Executor& executor, ClusterState& state, Index c, Tensor& a, Tensor& b);

}  // namespace nacre
