// K-clustered tensor approximation (Tsai and Shih 2012): Algorithm 1 with the clustering stage of
// Section 4.2, the update stage of Section 4.3 and the practice of Section 5. With one mixture
// cluster it is clustered tensor approximation (CTA, Tsai and Shih 2006).
#pragma once

#include <cstdint>
#include <vector>

#include "nacre/cluster_search.hpp"
#include "nacre/executor.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

struct KctaOptions {
    std::vector<Index> ranks;         // of each mode
    Index clustered = 1;              // the clustered mode m
    Index clusters = 1;               // C
    Index mixtures = 1;               // K
    std::vector<Index> global_modes;  // bases shared by all clusters (Section 5.2)
    MatrixD parameters;  // I_m x any: where each row of the clustered mode lies (Section 5.1)
    int iterations = 50;
    // Stop when an iteration changes neither the sum of core norms (Algorithm 1) nor the error by
    // more than this part.
    double tolerance = 5e-4;
    std::uint64_t seed = 0;
};

struct Kcta {
    std::vector<Tensor> cores;  // of each cluster, modes in order
    // bases[n] of each cluster, I x R; a single one for a global mode; none for the clustered mode,
    // whose rows are sparse: members (I_m x K, ascending) and coefficients (I_m x K x R_m).
    std::vector<std::vector<MatrixF>> bases;
    std::vector<ClusterId> members;
    std::vector<float> coefficients;
    std::vector<double> errors;  // ||A - approximation||^2 / ||A||^2 at the start and after each
                                 // iteration, never rising
    double squared_norm = 0;     // ||A||^2
    int iterations = 0;
};

// Needs the tensor reduced by the global bases (Eq. 23) in memory, but not the samples.
Kcta kcta(Executor& executor, const TensorSource& source, const KctaOptions& options);

// The Gram matrix of the clusters' reconstructions, gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T (R x R
// each, grouped by cluster), for any bases: bases[n][c], or a single bases[n][0] shared by all.
MatrixD core_gram(Executor& executor, const std::vector<Tensor>& cores,
                  const std::vector<std::vector<MatrixF>>& bases, Index clustered);

}  // namespace nacre
