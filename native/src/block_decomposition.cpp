#include "block_decomposition.hpp"

#include <algorithm>

#include "nacre/cluster_search.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"

namespace nacre {

namespace {

constexpr double kSweepTolerance = 1e-5;  // of the energy, from one sweep to the next

std::vector<const MatrixF*> all_but(const std::vector<MatrixF>& bases, Index skip, Index other) {
    std::vector<const MatrixF*> list(bases.size(), nullptr);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        const Index mode = static_cast<Index>(n);
        if (mode != skip && mode != other && bases[n].size() > 0) list[n] = &bases[n];
    }
    return list;
}

// The last mode with a rank: mode 0 always has one.
Index last_mode(const std::vector<Index>& ranks) {
    Index last = 0;
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (ranks[n] > 0) last = static_cast<Index>(n);
    }
    return last;
}

}  // namespace

MatrixF orthonormal(const MatrixF& basis) {
    const MatrixD u = basis.cast<double>();
    const MatrixD factor = inverse_factor(u.transpose() * u);
    // Members with no coefficients at all span nothing: any direction will do.
    if (factor.cols() == 0) return MatrixF::Identity(basis.rows(), 1);
    return (u * factor).cast<float>();
}

void pad(Executor& executor, const std::vector<Index>& ranks, std::vector<MatrixF>& bases,
         Tensor& core) {
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (ranks[n] == 0 || core.dim(static_cast<Index>(n)) == ranks[n]) continue;
        const Index present = core.dim(static_cast<Index>(n));
        const MatrixF identity = MatrixF::Identity(ranks[n], present);
        Tensor padded;
        mode_product(executor, core, static_cast<Index>(n), identity, Op::kNone, padded);
        core = std::move(padded);
        MatrixF basis = MatrixF::Zero(bases[n].rows(), ranks[n]);
        basis.leftCols(present) = bases[n];
        bases[n] = std::move(basis);
    }
}

// The bases of modes 1, 2, ... from the block projected on the first; leaves in a_ the block
// projected on all but the last.
void BlockDecomposition::update_others(Executor& executor, const std::vector<Index>& ranks,
                                       std::vector<MatrixF>& bases) {
    const Index last = last_mode(ranks);
    for (Index n = 1; n <= last; ++n) {
        if (ranks[at(n)] == 0) continue;
        const auto others = all_but(bases, 0, n);
        const bool none = std::none_of(others.begin(), others.end(), [](auto u) { return u; });
        if (!none) multi_mode_product(executor, lead_, others, Op::kTranspose, a_, b_);
        if (none && n == last) std::swap(a_, lead_);
        const Tensor& projected = none && n != last ? lead_ : a_;
        const Index rank = std::min(ranks[at(n)], projected.dim(n));
        bases[at(n)] = leading_basis(gram(executor, projected, n), rank);
    }
}

void BlockDecomposition::finish(Executor& executor, const std::vector<Index>& ranks,
                                std::vector<MatrixF>& bases, Tensor& core) {
    update_others(executor, ranks, bases);
    const Index last = last_mode(ranks);
    mode_product(executor, a_, last, bases[at(last)], Op::kTranspose, core);
}

void BlockDecomposition::run(Executor& executor, const Tensor& block, Index clustered,
                             const std::vector<Index>& ranks, int sweeps,
                             std::vector<MatrixF>& bases, Tensor& core) {
    const Index rank = std::min(ranks[0], block.dim(0)), last = last_mode(ranks);
    if (core.size() == 0) {
        for (MatrixF& basis : bases) basis.resize(0, 0);
        bases[0] = leading_basis(gram(executor, block, 0), rank);
        mode_product(executor, block, 0, bases[0], Op::kTranspose, lead_);
        update_others(executor, ranks, bases);
    } else {
        for (Index n = 1; n < clustered; ++n) bases[at(n)] = orthonormal(bases[at(n)]);
    }
    double kept = 0;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        if (last == 0) {
            bases[0] = leading_basis(gram(executor, block, 0), rank);
            mode_product(executor, block, 0, bases[0], Op::kTranspose, core);
            break;
        }
        multi_mode_product(executor, block, all_but(bases, 0, 0), Op::kTranspose, rest_, b_);
        bases[0] = leading_basis(gram(executor, rest_, 0), rank);
        mode_product(executor, block, 0, bases[0], Op::kTranspose, lead_);
        finish(executor, ranks, bases, core);
        if (sweep + 1 == sweeps) break;
        const double now = squared_norm(executor, core);
        if (now - kept <= kSweepTolerance * now) break;
        kept = now;
    }
    pad(executor, ranks, bases, core);
}

}  // namespace nacre
