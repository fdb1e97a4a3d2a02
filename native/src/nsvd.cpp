#include "nacre/nsvd.hpp"

#include <algorithm>

#include "nacre/errors.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/streaming.hpp"

namespace nacre {

namespace {

// Pointers to the bases in use, without mode `skip` and the lead mode.
std::vector<const MatrixF*> others(const std::vector<MatrixF>& bases, Index lead, Index skip) {
    std::vector<const MatrixF*> list(bases.size(), nullptr);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (static_cast<Index>(n) != lead && static_cast<Index>(n) != skip && bases[n].size() > 0) {
            list[n] = &bases[n];
        }
    }
    return list;
}

}  // namespace

void update_bases(Executor& executor, const Tensor& tensor, Index lead,
                  const std::vector<Index>& ranks, std::vector<MatrixF>& bases, Tensor& a,
                  Tensor& b) {
    for (Index n = 0; n < tensor.order(); ++n) {
        if (n == lead || ranks[at(n)] == 0) continue;
        // A basis that is still empty is left out of the projection: on the first pass this is the
        // sequentially truncated HOSVD.
        multi_mode_product(executor, tensor, others(bases, lead, n), Op::kTranspose, a, b);
        bases[at(n)] = leading_basis(gram(executor, a, n), ranks[at(n)]);
    }
}

Tucker nsvd(Executor& executor, const TensorSource& source, const NsvdOptions& options) {
    const Index order = static_cast<Index>(source.shape().size());
    Index lead = 0;
    while (lead < order && options.ranks[at(lead)] == 0) ++lead;
    Tucker result;
    result.bases.resize(at(order));
    if (lead == order) {
        result.core = load(executor, source);
        result.squared_norm = squared_norm(executor, result.core);
        result.errors.push_back(0);
        return result;
    }
    const bool alone = std::count(options.ranks.begin(), options.ranks.end(), 0) == order - 1;
    const Index lead_rank = options.ranks[at(lead)];

    executor.stage(0, 0.3, "N-SVD: covariance");
    const MatrixD lead_gram = gram(executor, source, lead);
    result.squared_norm = lead_gram.trace();
    std::vector<MatrixF>& bases = result.bases;
    bases[at(lead)] = leading_basis(lead_gram, lead_rank);

    const auto error_of = [&](const Tensor& core) {
        if (result.squared_norm <= 0) return 0.0;
        return std::max(0.0, 1 - squared_norm(executor, core) / result.squared_norm);
    };

    executor.stage(0.3, 0.4, "N-SVD: projection");
    Tensor projected = project(executor, source, lead, bases[at(lead)]);
    if (alone) {  // the start is the solution
        result.core = std::move(projected);
        result.errors.push_back(error_of(result.core));
        return result;
    }
    Tensor a, b;
    update_bases(executor, projected, lead, options.ranks, bases, a, b);
    const int iterations = std::max(options.iterations, 1);
    for (int i = 0; i < iterations; ++i) {
        const double begin = 0.4 + 0.6 * i / iterations, step = 0.6 / iterations;
        const std::string message = "N-SVD: iteration " + std::to_string(i + 1);
        std::vector<MatrixF> next = bases;

        executor.stage(begin, begin + 0.6 * step, message);
        update_bases(executor, projected, lead, options.ranks, next, a, b);
        {
            const Tensor rest = project_others(executor, source, lead, others(next, lead, lead));
            next[at(lead)] = leading_basis(gram(executor, rest, lead), lead_rank);
            mode_product(executor, rest, lead, next[at(lead)], Op::kTranspose, a);
        }
        const double error = error_of(a);
        const double last = i == 0 ? 2 : result.errors.back();  // no error is above 1
        // Alternating least squares cannot raise the error; rounding at its end can.
        if (error >= last) break;
        bases = std::move(next);
        std::swap(result.core, a);
        result.errors.push_back(error);
        if (last - error <= options.tolerance * last || i + 1 == iterations) break;

        executor.stage(begin + 0.6 * step, begin + step, message);
        projected = project(executor, source, lead, bases[at(lead)]);
    }
    executor.stage(1, 1, "N-SVD: done");
    return result;
}

void MemberDecomposition::run(Executor& executor, const Tensor& tensor,
                              const std::vector<Index>& ranks, int sweeps, double tolerance,
                              std::vector<MatrixF>& bases, Tensor& core) {
    const Index members = tensor.dim(0);
    const Index rank = std::min(ranks[0], members);
    bool start = false;
    for (Index n = 1; n < tensor.order(); ++n) {
        start = start || (ranks[at(n)] > 0 && bases[at(n)].size() == 0);
    }
    if (start) {
        for (std::size_t n = 1; n < bases.size(); ++n) bases[n].resize(0, 0);
        bases[0] = leading_basis(gram(executor, tensor, 0), rank);
        mode_product(executor, tensor, 0, bases[0], Op::kTranspose, lead_);
        update_bases(executor, lead_, 0, ranks, bases, scratch_, other_);
    }
    double last = 0;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        multi_mode_product(executor, tensor, others(bases, 0, 0), Op::kTranspose, rest_, scratch_);
        bases[0] = leading_basis(gram(executor, rest_, 0), rank);
        mode_product(executor, tensor, 0, bases[0], Op::kTranspose, lead_);
        update_bases(executor, lead_, 0, ranks, bases, scratch_, other_);
        multi_mode_product(executor, lead_, others(bases, 0, 0), Op::kTranspose, core, scratch_);
        if (sweep + 1 == sweeps) break;
        const double kept = squared_norm(executor, core);
        if (kept - last <= tolerance * kept) break;
        last = kept;
    }
    if (rank < ranks[0]) {  // fewer members than columns: the rest is zero
        const MatrixF basis = bases[0];
        bases[0].setZero(members, ranks[0]);
        bases[0].leftCols(rank) = basis;
        Shape shape = core.shape();
        const Index size = core.size();
        shape[0] = ranks[0];
        other_.reset(shape);
        std::copy_n(core.data(), size, other_.data());
        std::fill_n(other_.data() + size, other_.size() - size, 0.0f);
        std::swap(core, other_);
    }
}

}  // namespace nacre
