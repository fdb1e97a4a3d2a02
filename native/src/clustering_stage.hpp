// The products that the clustering stage needs (MK-CTA, Eqs. 16 and 17), and the reconstruction
// that goes the same way back.
#pragma once

#include "cluster_state.hpp"
#include "nacre/executor.hpp"

namespace nacre {

// Projections and Gram matrix of one clustered mode, columns grouped by cluster of the mode, then
// by owner: the subsets C_n,j that search_clusters calls clusters.
struct Products {
    MatrixD projections;  // rows of the mode x (count * owners * rank)
    MatrixD gram;
};

// spread_gram: <row, row'> of the spread cores of all clusters, which the clustering stage leaves
// alone; upper triangle, computed once for all modes.
MatrixD spread_gram(Executor& executor, const ClusterState& state);

// Eq. 17 from the above: blocks of clusters without common members in another mode are zero.
MatrixD subset_gram(Executor& executor, const ClusterState& state, Index k,
                    const MatrixD& spread_gram);

// Eq. 16, taken as <A, Z x_n U_n> with the cores expanded row by row of the other clustered modes.
MatrixD subset_projections(Executor& executor, const ClusterState& state, Index k,
                           const Tensor& tensor);

// residual = tensor - its approximation.
void residual(Executor& executor, const ClusterState& state, const Tensor& tensor,
              Tensor& residual);

}  // namespace nacre
