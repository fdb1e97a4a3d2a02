#include <algorithm>

#include "decomposition_stage.hpp"
#include "in_place_update.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "thin_product.hpp"

namespace nacre {

namespace {

constexpr Index kColumns = 512;  // of a member, at a time

Index divide_up(Index a, Index b) { return (a + b - 1) / b; }

// result = (residual + what the cluster adds) x_n U_n^T over its members, with every basis but that
// of the clustered mode. What the cluster adds is its core, but for rounding of its bases.
void project(Executor& executor, const ClusterState& state, Index c, const Tensor& residual,
             Tensor& result, Tensor& a, Tensor& b) {
    const std::vector<MatrixF>& bases = state.bases[at(c)];
    const Index columns = state.columns();
    const std::vector<Index>& members = state.members(c, 0);
    // Each member in pieces: one for each index of the first modes, as far as they have no basis.
    Index pieces = 1;
    std::size_t first = 1;
    while (bases[first].size() == 0) pieces *= state.shape()[first++];
    Shape piece(state.shape().begin() + static_cast<std::ptrdiff_t>(first), state.shape().end());
    Bases own(piece.size(), nullptr);
    Index largest = 1, smallest = 1;
    for (std::size_t n = 0; n < piece.size(); ++n) {
        if (bases[first + n].size() > 0) own[n] = &bases[first + n];
        largest *= own[n] ? std::max(piece[n], own[n]->cols()) : piece[n];
        smallest *= own[n] ? own[n]->cols() : piece[n];
    }
    const std::vector<Index> modes = product_order(own, Op::kTranspose);
    Shape shape = state.shape();
    shape[0] = static_cast<Index>(members.size());
    for (std::size_t n = 0; n < piece.size(); ++n) {
        if (own[n]) shape[first + n] = own[n]->cols();
    }
    result.reset(shape);
    executor.parallel_for(shape[0] * pieces, [&](Index task, int) {
        thread_local Buffer even, odd;
        even.reserve(largest);
        odd.reserve(largest);
        Shape now = piece;
        const float* from = residual.data() + members[at(task / pieces)] * columns +
                            task % pieces * (columns / pieces);
        for (std::size_t i = 0; i < modes.size(); ++i) {
            float* to = i + 1 == modes.size() ? result.data() + task * smallest
                        : i % 2 == 0          ? even.data()
                                              : odd.data();
            const Index n = modes[i];
            mode_product(from, unfolding(now, n), *own[at(n)], Op::kTranspose, to);
            now[at(n)] = own[at(n)]->cols();
            from = to;
        }
    });
    std::vector<MatrixF> turned(bases.size());
    Bases change(bases.size(), nullptr);
    for (std::size_t n = 1; n < bases.size(); ++n) {
        if (bases[n].size() == 0) continue;
        turned[n] = bases[n].transpose() * bases[n];
        change[n] = &turned[n];
    }
    multi_mode_product(executor, state.cores[at(c)], change, Op::kNone, a, b);
    const Index rank = bases[0].cols(), width = pieces * smallest;
    executor.parallel_for(divide_up(width, kColumns), [&](Index task, int) {
        const Index at_column = task * kColumns, count = std::min(kColumns, width - at_column);
        std::vector<const float*> from;
        std::vector<float*> to;
        for (Index r = 0; r < rank; ++r) from.push_back(a.data() + r * width + at_column);
        for (Index i = 0; i < shape[0]; ++i) to.push_back(result.data() + i * width + at_column);
        thin_product(shape[0], count, rank, bases[0].data(), from.data(), true, to.data());
    });
}

}  // namespace

void update_one_mode(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch) {
    const std::vector<Index>& members = state.members(c, 0);
    if (members.empty()) return;
    const Index columns = state.columns(), count = static_cast<Index>(members.size());
    std::vector<MatrixF>& bases = state.bases[at(c)];
    project(executor, state, c, residual, scratch.rest, scratch.core, scratch.other);
    const MatrixF before = bases[0];
    const Index old_rank = before.cols();
    bases[0] = leading_basis(gram(executor, scratch.rest, 0), std::min(state.ranks()[0], count));
    const Index rank = bases[0].cols(), parts = divide_up(columns, kColumns);
    scratch.old_core.reset({old_rank, columns});
    std::copy_n(state.spread(c), old_rank * columns, scratch.old_core.data());

    // The members projected on the new basis; the cluster's own rows are more rows to sum over.
    MatrixF weights(rank, count + old_rank);
    weights << bases[0].transpose(), bases[0].transpose() * before;
    Tensor& lead = scratch.decomposition.lead();
    Shape shape = state.shape();
    shape[0] = rank;
    lead.reset(std::move(shape));
    executor.parallel_for(parts, [&](Index task, int) {
        const Index first = task * kColumns, width = std::min(kColumns, columns - first);
        std::vector<const float*> from;
        std::vector<float*> to;
        for (Index row : members) from.push_back(residual.data() + row * columns + first);
        for (Index r = 0; r < old_rank; ++r) {
            from.push_back(scratch.old_core.data() + r * columns + first);
        }
        for (Index r = 0; r < rank; ++r) to.push_back(lead.data() + r * columns + first);
        thin_product(rank, width, count + old_rank, weights.data(), from.data(), false, to.data());
    });
    scratch.decomposition.finish(executor, state.ranks(), bases, state.cores[at(c)]);
    pad(executor, state.ranks(), bases, state.cores[at(c)]);
    spread_core(executor, state, c, scratch.core, scratch.other);

    weights.resize(count, old_rank + bases[0].cols());
    weights << before, -bases[0];
    executor.parallel_for(parts, [&](Index task, int) {
        const Index first = task * kColumns, width = std::min(kColumns, columns - first);
        std::vector<const float*> from;
        std::vector<float*> to;
        for (Index r = 0; r < old_rank; ++r) {
            from.push_back(scratch.old_core.data() + r * columns + first);
        }
        for (Index r = 0; r < bases[0].cols(); ++r) {
            from.push_back(state.spread(c) + r * columns + first);
        }
        for (Index row : members) to.push_back(residual.data() + row * columns + first);
        thin_product(count, width, weights.cols(), weights.data(), from.data(), true, to.data());
    });
}

}  // namespace nacre
