// Clustered, sparse tensor approximation. One algorithm fits all of CTA (Tsai and Shih 2006; one
// clustered mode, K = 1), K-CTA (Tsai and Shih 2012; one clustered mode) and MK-CTA (Tsai 2015;
// several clustered modes): alternate a clustering stage, which gives every subtensor of every
// clustered mode its K clusters and mixing coefficients, with a decomposition stage, which fits
// core and bases of one cluster at a time to what the others leave over.
//
// A cluster is a vector of one cluster index for each clustered mode, numbered with the last mode
// fastest. Its basis of a clustered mode has nonzero rows for its members alone.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "nacre/cluster_search.hpp"
#include "nacre/executor.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"
#include "nacre/workspace.hpp"

namespace nacre {

struct ClusteredMode {
    Index mode = 1;
    Index clusters = 1;  // C
    Index mixtures = 1;  // K
    // items x any: where each item lies (Section 5.1 of the K-CTA paper). An item is a row of the
    // mode, or the rows that the source ties together: the colours of one light.
    MatrixD parameters;
};

struct ClusteredOptions {
    std::vector<Index> ranks;              // of each mode
    std::vector<ClusteredMode> clustered;  // modes ascending, at least one
    std::vector<Index> global_modes;       // bases shared by all clusters
    SearchMethod search = SearchMethod::kAuto;
    int iterations = 50;
    // Stop when an iteration changes neither the sum of core norms (Algorithm 1) nor the error by
    // more than this part.
    double tolerance = 5e-4;
    std::uint64_t seed = 0;
};

struct ClusteredTucker {
    std::vector<Tensor> cores;  // of each cluster, modes in order
    // bases[n][o], I x (K R): of owner o of mode n. Owners are the combinations of the other
    // clustered modes' clusters, or one where the basis is global. In a clustered mode, columns
    // [k R, (k + 1) R) of a row belong to the k-th of its clusters; elsewhere K is 1.
    std::vector<std::vector<MatrixF>> bases;
    // members[k], items x K ascending, of the k-th clustered mode.
    std::vector<std::vector<ClusterId>> members;
    // ||A - approximation||^2 / ||A||^2 of the first guess and after each iteration; never rising.
    std::vector<double> errors;
    double squared_norm = 0;  // ||A||^2
};

// Called with the state after each iteration that is followed by another. A fit that starts from
// such a state goes on exactly as the one that reported it would have.
using ClusteredCheckpoint = std::function<void(const ClusteredTucker&)>;

// The samples are streamed; what is kept of them is the tensor reduced by the global bases (Eq. 23
// of the K-CTA paper) and its residual, both in `workspace`. `start`, if given, replaces the first
// guess: a checkpoint, or any model of these shapes (with no errors: they are computed).
ClusteredTucker fit_clustered(Executor& executor, const Workspace& workspace,
                              const TensorSource& source, const ClusteredOptions& options,
                              const ClusteredTucker* start = nullptr,
                              const ClusteredCheckpoint& checkpoint = {});

}  // namespace nacre
