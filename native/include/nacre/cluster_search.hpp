// The clustering stage in the reduced tensor space (Section 4.2 of the K-CTA paper, Sections 3.5
// and 4.1.1 of the MK-CTA paper): which mixture clusters a subtensor belongs to, and with which
// mixing coefficients.
//
// All that is needed of a subtensor A<i> are its projections on every cluster,
//     a_c = ufm(A<i>^(c)) ufm(Z_c)^T            (K-CTA, Eqs. 10, 18 and 19; 1 x R),
// and of the clusters their Gram matrix, whose block of row j and column c is
//     gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T      (K-CTA, Eqs. 14 and 17; R x R).
// In MK-CTA a subtensor is given whole subsets C_n,j of clusters, all those whose n-th index is j:
// "cluster" here is such a subset and R the rank of all its clusters together (MK-CTA, Eqs. 5, 6;
// the products are its Eqs. 16 and 17).
//
// Rows may be tied: `tied` rows that follow each other (the colours of one light) share clusters,
// and what is maximised is summed over them. Such a group is an item.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

using ClusterId = std::uint32_t;

enum class SearchMethod {
    kAuto,     // one clustered mode: kKcta; several: kOptimal for K < 3, else kGreedy
    kKcta,     // greedy, each further cluster for the residual (K-CTA, Theorems 1 and 3)
    kGreedy,   // greedy, each further cluster with all coefficients anew: orthogonal least squares
               // (MK-CTA, Eq. 11 and Algorithm 3)
    kOptimal,  // the best of all sets (MK-CTA, Eq. 4 and Algorithm 2)
};

// What a search needs to know.
struct ReducedItems {
    const double* projections;  // rows x (clusters * rank)
    Index rows;
    Index tied;           // divides rows
    const MatrixD& gram;  // (clusters * rank)^2, rows and columns grouped by cluster
    Index clusters, rank;

    Index items() const { return rows / tied; }
};

// Symmetric matrices here are Gram matrices that came out of single precision products, and their
// model is stored in half precision. Directions that differ from the others by less than this
// (squared sine of the angle) are taken as dependent.
inline constexpr double kDependent = 1e-6;

// A factor L of the pseudo-inverse, L L^T = G^+, of a positive semidefinite G; n x rank. G is
// scaled to a unit diagonal first, so that what counts as dependent does not depend on how bright
// a cluster is. (For deficient G this is a generalised inverse, as good for least squares.)
MatrixD inverse_factor(const MatrixD& gram);

struct Membership {
    std::vector<ClusterId> clusters;   // items x mixtures, each ascending
    std::vector<double> coefficients;  // rows x mixtures x rank: Eq. 15 (MK-CTA: Eq. 8)
};

// The clusters of every item. `candidates` (items x sets x mixtures, may be empty) are further
// choices for each; whichever explains most energy after optimal projection wins, the search's own
// in doubt. `method` is not kAuto.
Membership search_clusters(Executor& executor, const ReducedItems& items, Index mixtures,
                           SearchMethod method, std::span<const ClusterId> candidates = {},
                           Index sets = 0);

}  // namespace nacre
