// Gram matrices of unfoldings, ufn(A) ufn(A)^T, and the truncated bases that they give.
#pragma once

#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// Adds up the Gram matrix of one mode from pieces of a tensor. Products run in float over at most
// a few thousand columns and are added up in double, which keeps the accuracy of a float SVD.
class GramSum {
  public:
    explicit GramSum(Index rows);
    // A piece seen as outer x rows x inner, C order; `stride` is the distance between rows.
    void add(const float* piece, const Unfolding& view);
    void add_columns(const float* piece, Index columns, Index stride);
    // The upper triangle so far (the lower one is 0).
    const MatrixD& finish();

  private:
    void flush();
    void make_room(Index columns);

    Index rows_;
    Index columns_ = 0;  // columns in partial_ since the last flush
    MatrixF partial_;
    MatrixD sum_;
};

// Fills the lower triangle from the upper one.
void symmetrise(MatrixD& upper);

// The Gram matrix of the mode-n unfolding, both triangles.
MatrixD gram(Executor& executor, const Tensor& tensor, Index mode);

// sum (m x n, row stride lds) += x y^T, where x is m x columns and y is n x columns with these row
// strides; in float over a few hundred columns each, these in double.
void add_inner_products(Index m, Index n, Index columns, const float* x, Index ldx, const float* y,
                        Index ldy, double* sum, Index lds);

// How many slabs a sum of `tasks` pieces is cut into: fixed, so that the order of additions is.
Index slab_count(Index tasks);

// The `rank` leading eigenvectors of a Gram matrix as columns, ordered by eigenvalue; the entry of
// largest magnitude of each is positive. These are the leading left singular vectors of the
// unfolding.
MatrixF leading_basis(MatrixD gram, Index rank);

}  // namespace nacre
