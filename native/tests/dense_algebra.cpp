#include "dense_algebra.hpp"

#include <Eigen/SVD>

namespace nacre::dense {

Svd svd(const MatrixD& m) {
    const Eigen::JacobiSVD<MatrixD> solver(m, Eigen::ComputeThinU | Eigen::ComputeThinV);
    return {solver.matrixU(), solver.singularValues(), solver.matrixV()};
}

MatrixD pseudo_inverse(const MatrixD& m) {
    const Svd parts = svd(m);
    VectorD inverse = VectorD::Zero(parts.s.size());
    for (Index i = 0; i < inverse.size(); ++i) {
        if (parts.s(i) > kZero * parts.s(0)) inverse(i) = 1 / parts.s(i);
    }
    return parts.v * inverse.asDiagonal() * parts.u.transpose();
}

MatrixD inverse_root(const MatrixD& m) {
    const Svd parts = svd(m);
    return parts.u * parts.s.cwiseSqrt().cwiseInverse().asDiagonal() * parts.u.transpose();
}

MatrixD orthonormal(const MatrixD& basis) {
    if (basis.size() == 0) return MatrixD::Zero(basis.rows(), 0);
    const Svd parts = svd(basis);
    Index rank = 0;
    for (Index i = 0; i < parts.s.size(); ++i) rank += parts.s(i) > 1e-3 * parts.s(0);
    return parts.u.leftCols(rank);
}

}  // namespace nacre::dense
