// The clustering stage in the reduced tensor space (Section 4.2 of the K-CTA paper): which mixture
// clusters a subtensor belongs to, and with which mixing coefficients.
//
// All that is needed of a subtensor A<i> are its projections on every cluster,
//     a_c = ufm(A<i>^(c)) ufm(Z_c)^T            (Eqs. 10, 18 and 19; 1 x R),
// and of the clusters their Gram matrix, whose block of row j and column c is
//     gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T      (Eqs. 14 and 17; R x R).
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

using ClusterId = std::uint32_t;

// Symmetric matrices here are Gram matrices that came out of single precision products, and their
// model is stored in half precision. Directions that differ from the others by less than this
// (squared sine of the angle) are taken as dependent.
inline constexpr double kDependent = 1e-6;

// A factor L of the pseudo-inverse, L L^T = G^+, of a positive semidefinite G; n x rank. G is
// scaled to a unit diagonal first, so that what counts as dependent does not depend on how bright
// a cluster is. (For deficient G this is a generalised inverse, as good for least squares.)
MatrixD inverse_factor(const MatrixD& gram);

class ClusterSearch {
  public:
    // gram: (clusters * rank) x (clusters * rank), rows and columns grouped by cluster.
    ClusterSearch(const MatrixD& gram, Index clusters, Index rank);

    struct Mixture {
        std::vector<ClusterId> clusters;  // ascending
        VectorD coefficients;             // rank for each, in that order
        double energy = 0;                // squared norm of the optimal projection
    };

    // The greedy search: the first mixture cluster by Theorem 1 (Eq. 9), each further one by
    // Theorem 3 (Eq. 13), all coefficients anew by Theorem 4 (Eq. 15) after each.
    // projections: clusters * rank.
    Mixture greedy(std::span<const double> projections, Index mixtures);

    // Eq. 15 for given clusters (distinct, in any order).
    Mixture project(std::span<const double> projections, std::span<const ClusterId> clusters);

  private:
    const MatrixD& factor_of(const std::vector<ClusterId>& clusters);

    const MatrixD& gram_;
    Index clusters_, rank_;
    std::vector<MatrixD> dual_;  // of each cluster: S_c^(-1/2), up to a rotation
    // Factors of the sets that came up: a resampled mode has many rows and few sets.
    struct Hash {
        std::size_t operator()(const std::vector<ClusterId>& set) const;
    };
    std::unordered_map<std::vector<ClusterId>, MatrixD, Hash> factors_;
};

struct Membership {
    std::vector<ClusterId> clusters;   // rows x mixtures, each row ascending
    std::vector<double> coefficients;  // rows x mixtures x rank
};

// The greedy search for every row of `projections` (rows x clusters * rank). `candidates`
// (rows x sets x mixtures, may be empty) are further choices for each row; whichever explains most
// energy after optimal projection wins, the greedy one in doubt.
Membership search_clusters(Executor& executor, const double* projections, Index rows,
                           const MatrixD& gram, Index clusters, Index rank, Index mixtures,
                           std::span<const ClusterId> candidates = {}, Index sets = 0);

}  // namespace nacre
