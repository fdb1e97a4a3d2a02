// Algorithm 1 of both papers on the reduced tensor.
#pragma once

#include <string>
#include <vector>

#include "cluster_state.hpp"
#include "decomposition_stage.hpp"
#include "nacre/clustered.hpp"

namespace nacre {

class ClusteredFit {
  public:
    // modes: those of the source in the order of `reduced`, clustered ones first.
    ClusteredFit(Executor& executor, const Workspace& workspace, const TensorSource& source,
                 const ClusteredOptions& options, std::vector<Index> modes,
                 std::vector<MatrixF> globals, Tensor reduced, double energy);

    void start();
    void start_from(const ClusteredTucker& model);
    void iterate(const ClusteredCheckpoint& checkpoint);
    // A complete model has all its mixture clusters; the other is what start_from() needs.
    ClusteredTucker model(bool complete = true) const;

  private:
    // What a step back restores.
    struct Snapshot {
        std::vector<Grouping> groupings;
        std::vector<Tensor> cores;
        std::vector<std::vector<MatrixF>> bases;
    };

    void cluster_modes(bool warm);
    bool split_empty(Index k, MatrixD& projections, MatrixD& gram, Index mixtures,
                     Membership& found);
    void assign(Index k, const Membership& found, Index mixtures);
    SearchMethod method(Index mixtures) const;
    bool all_mixtures() const;
    void restore(const Snapshot& snapshot);
    void spread_cores();
    double error();
    double core_norms() const;

    Executor& executor_;
    const ClusteredOptions& options_;
    const std::vector<Index> modes_;
    const std::vector<MatrixF> globals_;
    const Tensor tensor_;
    double energy_;       // ||A||^2, before the reduction
    double lost_energy_;  // ||A||^2 - ||A_G||^2
    ClusterState state_;
    Tensor residual_;
    DecompositionStage decomposition_;
    std::vector<VectorD> row_energy_;  // of each clustered mode
    std::vector<double> errors_;
};

}  // namespace nacre
