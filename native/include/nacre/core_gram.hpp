// How the clusters of a finished model overlap: what search_clusters needs to place new rows.
#pragma once

#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// The Gram matrix of the clusters' reconstructions, gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T (R x R
// each, grouped by cluster; Eqs. 14 and 17 of the K-CTA paper), for one clustered mode and any
// bases: bases[n][c], or a single bases[n][0] shared by all.
MatrixD core_gram(Executor& executor, const std::vector<Tensor>& cores,
                  const std::vector<std::vector<MatrixF>>& bases, Index clustered);

}  // namespace nacre
