#include "dictionary.hpp"

#include <algorithm>

#include "nacre/blas.hpp"
#include "nacre/gram.hpp"

namespace nacre {

namespace {

// How much the last matrix weighs against the target: enough to say which of equal solutions is
// meant, too little to change one that is not open.
constexpr double kLastWeight = 1e-7;

}  // namespace

double orthonormality_error(const Ensemble& ensemble) {
    double most = 0;
    for (const Dictionary& dictionary : ensemble) {
        for (const MatrixF& matrix : dictionary) {
            const MatrixD u = matrix.cast<double>();
            const MatrixD rest = u.transpose() * u - MatrixD::Identity(u.cols(), u.cols());
            most = std::max(most, rest.cwiseAbs().maxCoeff());
        }
    }
    return most;
}

std::vector<PatchBuffers> patch_buffers(const Executor& executor, const Patches& patches) {
    std::vector<PatchBuffers> buffers;
    for (int i = 0; i < executor.threads(); ++i) buffers.emplace_back(patches.size());
    return buffers;
}

Projected project(const Shape& shape, const Dictionary& dictionary, Index skip,
                  PatchBuffers& buffers) {
    const float* from = buffers.patch.data();
    float *to = buffers.first.data(), *other = buffers.second.data();
    for (std::size_t n = 0; n < shape.size(); ++n) {
        const Index mode = static_cast<Index>(n);
        if (mode == skip) continue;
        mode_product(from, unfolding(shape, mode), dictionary[n], Op::kTranspose, to);
        from = to;
        std::swap(to, other);
    }
    if (from == buffers.patch.data()) {  // the only mode is left out
        std::copy_n(from, product(shape), to);
        std::swap(to, other);
    }
    return {other, to};
}

Dictionary hosvd(const std::vector<MatrixD>& grams) {
    Dictionary dictionary;
    for (const MatrixD& gram : grams) dictionary.push_back(leading_basis(gram, gram.rows()));
    return dictionary;
}

MatrixF procrustes(const MatrixD& target, const MatrixF& last) {
    // tr(U^T target) + weight tr(U^T last) is largest for the new U, and its second term for U =
    // last, so the first one does not fall.
    const double weight = kLastWeight * target.norm();
    if (weight == 0) return last;
    const MatrixD before = last.cast<double>();
    MatrixD left = target + weight * before, right;
    singular_vectors(left, right);
    const MatrixD found = left * right;
    // Rounding must not undo that.
    const double gain = (found - before).cwiseProduct(target).sum();
    return gain > 0 ? MatrixF(found.cast<float>()) : last;
}

}  // namespace nacre
