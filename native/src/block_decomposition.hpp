// N-SVD of the members of one cluster, a tensor in memory.
#pragma once

#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// The post-process (MK-CTA, Section 3.5.3; K-CTA, Section 4.2.3): orthonormal columns with the same
// span, which may be fewer but are at least one.
MatrixF orthonormal(const MatrixF& basis);

// Brings core and bases to these ranks (0: any) with columns of zeros.
void pad(Executor& executor, const std::vector<Index>& ranks, std::vector<MatrixF>& bases,
         Tensor& core);

// Keeps its memory from one call to the next.
class BlockDecomposition {
  public:
    // The first `clustered` modes are members' rows: they may be fewer than the rank, and then the
    // basis has that many orthonormal columns and the rest is zero. Rank 0 leaves a mode alone.
    // `bases` (one for each mode) are the start, those of clustered modes with any columns; without
    // a core yet, the truncated HOSVD is. All are updated, and so is the core.
    void run(Executor& executor, const Tensor& block, Index clustered,
             const std::vector<Index>& ranks, int sweeps, std::vector<MatrixF>& bases,
             Tensor& core);

    // The second half of a sweep for whoever knows the first basis: the bases of the other modes
    // and the core from lead(), the block projected on the first basis, which is lost. One of the
    // other modes has a rank.
    Tensor& lead() { return lead_; }
    void finish(Executor& executor, const std::vector<Index>& ranks, std::vector<MatrixF>& bases,
                Tensor& core);

  private:
    void update_others(Executor& executor, const std::vector<Index>& ranks,
                       std::vector<MatrixF>& bases);

    Tensor rest_, lead_, a_, b_;
};

}  // namespace nacre
