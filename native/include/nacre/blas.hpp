// The few BLAS and LAPACK calls in use, row-major, each on the calling thread alone: the library
// does its own threading (see Executor).
#pragma once

#include "nacre/tensor.hpp"

namespace nacre {

enum class Op { kNone, kTranspose };

// c (m x n) = alpha op(a) op(b) + beta c, where op(a) is m x k and op(b) is k x n; ld* are the row
// strides of a, b and c as stored.
void gemm(Op op_a, Op op_b, Index m, Index n, Index k, float alpha, const float* a, Index lda,
          const float* b, Index ldb, float beta, float* c, Index ldc);
void gemm(Op op_a, Op op_b, Index m, Index n, Index k, double alpha, const double* a, Index lda,
          const double* b, Index ldb, double beta, double* c, Index ldc);

// Upper triangle of c (n x n) = op(a) op(a)^T + beta c, where op(a) is n x k.
void syrk_upper(Op op_a, Index n, Index k, const float* a, Index lda, float beta, float* c,
                Index ldc);

// Eigenvalues in ascending order; the rows of `matrix` (symmetric; only one triangle is read)
// become the eigenvectors.
VectorD symmetric_eigen(MatrixD& matrix);

// The `count` largest eigenvalues, in descending order, of a symmetric matrix (only the upper
// triangle is read, all is lost); row i of `vectors` becomes the eigenvector of the i-th. Quicker
// than all of them.
VectorD leading_eigen(MatrixD& matrix, Index count, MatrixD& vectors);

// The singular value decomposition A diag(s) B of a square matrix: columns of `matrix` become the
// left singular vectors, A, and rows of `right` the right ones, B. Values in descending order.
VectorD singular_vectors(MatrixD& matrix, MatrixD& right);

}  // namespace nacre
