// What training and coding do with one dictionary and one patch.
#pragma once

#include "nacre/ensemble.hpp"
#include "nacre/mode_product.hpp"

namespace nacre {

// Scratch memory of one thread.
struct PatchBuffers {
    Buffer patch, first, second;
    explicit PatchBuffers(Index size) : patch(size), first(size), second(size) {}
};
std::vector<PatchBuffers> patch_buffers(const Executor& executor, const Patches& patches);

// The patch projected on every matrix but that of `skip` (-1: none), X x_n U_n^T (Eq. 3); the
// result is in one of the other two buffers, the remaining one may be overwritten.
struct Projected {
    float *values, *spare;
};
Projected project(const Shape& shape, const Dictionary& dictionary, Index skip,
                  PatchBuffers& buffers);

// Eigenvectors of the modes' Gram matrices: the bases of the higher-order SVD, all columns.
Dictionary hosvd(const std::vector<MatrixD>& grams);

// The orthonormal matrix U that maximises tr(U^T target), of which the singular value decomposition
// gives U = A B^T (orthogonal Procrustes problem); where the target leaves columns open, those
// nearest to `last`.
MatrixF procrustes(const MatrixD& target, const MatrixF& last);

}  // namespace nacre
