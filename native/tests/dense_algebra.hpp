// Singular values and what follows from them, compiled once for all tests: Eigen's solvers take
// longer to compile than everything else, above all with the sanitizers.
#pragma once

#include "nacre/tensor.hpp"

namespace nacre::dense {

// m = u s v^T with as many columns as the smaller side of m; s falls.
struct Svd {
    MatrixD u;
    VectorD s;
    MatrixD v;
};
Svd svd(const MatrixD& m);

// Singular values below this part of the largest count as zero.
inline constexpr double kZero = 1e-12;

MatrixD pseudo_inverse(const MatrixD& m);

// (S S^T)^(-1/2) of a matrix S S^T.
MatrixD inverse_root(const MatrixD& m);

// The post-process (MK-CTA, Section 3.5.3): orthonormal columns with the same span, as many as that
// has dimensions; directions of a squared sine below 1e-6 do not count.
MatrixD orthonormal(const MatrixD& basis);

}  // namespace nacre::dense
