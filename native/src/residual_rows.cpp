#include "residual_rows.hpp"

#include <algorithm>

#include "decomposition_stage.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "thin_product.hpp"

namespace nacre {

namespace {

constexpr Index kColumns = 512;  // of a slice, at a time

Index divide_up(Index a, Index b) { return (a + b - 1) / b; }

// One cluster: core (ranks..., columns) and the bases of its clustered modes.
struct Part {
    Tensor& core;
    std::vector<MatrixF> bases;
};

// Where the members' rows lie in the residual.
class Rows {
  public:
    Rows(const ClusterState& state, Index c) : columns_(state.columns()) {
        Shape stride(at(state.clustered()), 1);
        for (Index k = state.clustered() - 1; k > 0; --k) {
            stride[at(k - 1)] = stride[at(k)] * state.groupings[at(k)].rows;
        }
        offsets_ = {0};
        for (Index k = 0; k < state.clustered(); ++k) {
            const std::vector<Index>& members = state.members(c, k);
            shape_.push_back(static_cast<Index>(members.size()));
            std::vector<Index> next;
            for (Index offset : offsets_) {
                for (Index row : members) next.push_back(offset + row * stride[at(k)] * columns_);
            }
            offsets_ = std::move(next);
        }
    }

    const Shape& shape() const { return shape_; }
    Index slices(Index mode) const {
        return static_cast<Index>(offsets_.size()) / shape_[at(mode)];
    }

    // The rows along one mode, all else being fixed; slices as in the view of that mode.
    template <class T>
    std::vector<T*> along(T* data, Index mode, Index slice) const {
        const auto [outer, rows, inner] = unfolding(shape_, mode);
        std::vector<T*> list;
        for (Index row = 0; row < rows; ++row) {
            const Index index = (slice / inner * rows + row) * inner + slice % inner;
            list.push_back(data + offsets_[at(index)]);
        }
        return list;
    }

  private:
    Index columns_;
    Shape shape_;
    std::vector<Index> offsets_;
};

// The weights of the core's rows in one row of its expansion: the Kronecker product of `row`, which
// slice number `slice` of mode `skip` has in the bases of the other clustered modes, with `own` in
// the place of that mode.
void core_weights(const Rows& rows, const Part& part, Index skip, Index slice, const float* own,
                  float* weights) {
    const Index modes = static_cast<Index>(part.bases.size());
    std::vector<Index> position(at(modes), 0);
    for (Index q = modes; q-- > 0;) {
        if (q == skip) continue;
        position[at(q)] = slice % rows.shape()[at(q)];
        slice /= rows.shape()[at(q)];
    }
    Index size = 1;
    weights[0] = 1;
    for (Index q = 0; q < modes; ++q) {
        const MatrixF& u = part.bases[at(q)];
        const float* factors = q == skip ? own : u.data() + position[at(q)] * u.cols();
        for (Index i = size; i-- > 0;) {
            const float w = weights[i];
            for (Index r = u.cols(); r-- > 0;) weights[i * u.cols() + r] = w * factors[r];
        }
        size *= u.cols();
    }
}

std::vector<const float*> core_rows(const Part& part, Index first) {
    const Index columns = part.core.dim(part.core.order() - 1);
    std::vector<const float*> list;
    for (Index i = 0; i < part.core.size(); i += columns) {
        list.push_back(part.core.data() + i + first);
    }
    return list;
}

// result = (residual + what the cluster adds) x_mode U^T over its members. That is not formed: the
// core's rows are more rows to sum over.
void contract(Executor& executor, const Rows& rows, const Part& part, const Tensor& residual,
              Index mode, const MatrixF& basis, Tensor& result) {
    const Index columns = part.core.dim(part.core.order() - 1);
    const Index members = basis.rows(), rank = basis.cols();
    Shape shape = rows.shape();
    shape[at(mode)] = rank;
    shape.push_back(columns);
    result.reset(shape);
    const MatrixF change = basis.transpose() * part.bases[at(mode)];
    const std::vector<const float*> cores = core_rows(part, 0);
    const Index depth = members + static_cast<Index>(cores.size());
    const Index inner = unfolding(rows.shape(), mode).inner;
    executor.parallel_for(rows.slices(mode), [&](Index slice, int) {
        std::vector<const float*> from;
        for (const float* row : rows.along(residual.data(), mode, slice)) from.push_back(row);
        from.insert(from.end(), cores.begin(), cores.end());
        std::vector<float> weights(at(rank * depth));
        std::vector<float*> to;
        for (Index r = 0; r < rank; ++r) {
            float* of_row = weights.data() + r * depth;
            for (Index i = 0; i < members; ++i) of_row[i] = basis(i, r);
            core_weights(rows, part, mode, slice, change.data() + r * change.cols(),
                         of_row + members);
            const Index row = (slice / inner * rank + r) * inner + slice % inner;
            to.push_back(result.data() + row * columns);
        }
        thin_product(rank, columns, depth, weights.data(), from.data(), false, to.data());
    });
}

// residual += one part - another.
void exchange(Executor& executor, const Rows& rows, const Part& out, const Part& in,
              Tensor& residual) {
    const Index last = static_cast<Index>(out.bases.size()) - 1;
    const Index columns = out.core.dim(out.core.order() - 1);
    const MatrixF &u = out.bases[at(last)], &v = in.bases[at(last)];
    const Index rank = u.cols(), count = static_cast<Index>(core_rows(out, 0).size());
    MatrixF weights(u.rows(), 2 * rank);
    weights << u, -v;
    const MatrixF identity = MatrixF::Identity(rank, rank);
    const Index slices = rows.slices(last), parts = divide_up(columns, kColumns);
    executor.parallel_for(parts * slices, [&](Index task, int) {
        const Index slice = task % slices, first = task / slices * kColumns;
        const Index width = std::min(kColumns, columns - first);
        // This slice of both, expanded over all modes but the last: in the first cache.
        thread_local Buffer expanded;
        expanded.reserve(2 * rank * width);
        std::vector<float> mixing(at(rank * count));
        std::vector<float*> to;
        for (Index r = 0; r < 2 * rank; ++r) to.push_back(expanded.data() + r * width);
        for (const Part* part : {&out, &in}) {
            for (Index r = 0; r < rank; ++r) {
                core_weights(rows, *part, last, slice, identity.data() + r * rank,
                             mixing.data() + r * count);
            }
            thin_product(rank, width, count, mixing.data(), core_rows(*part, first).data(), false,
                         to.data() + (part == &out ? 0 : rank));
        }
        const std::vector<const float*> from(to.begin(), to.end());
        std::vector<float*> changed;
        for (float* row : rows.along(residual.data(), last, slice)) changed.push_back(row + first);
        thin_product(u.rows(), width, 2 * rank, weights.data(), from.data(), true, changed.data());
    });
}

void update_several(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                    ResidualScratch& scratch) {
    const Rows rows(state, c);
    const Index modes = state.clustered();
    Shape shape;
    for (Index k = 0; k < modes; ++k) {
        if (rows.shape()[at(k)] == 0) return;
        shape.push_back(state.groupings[at(k)].rank);
    }
    shape.push_back(state.columns());
    Part old{scratch.old_core, {}}, now{scratch.core, {}};
    old.core.reset(shape);
    std::copy_n(state.cores[at(c)].data(), old.core.size(), old.core.data());
    for (Index k = 0; k < modes; ++k) old.bases.push_back(state.bases[at(c)][at(k)]);
    now.bases = old.bases;
    for (Index k = 1; k < modes; ++k) now.bases[at(k)] = orthonormal(now.bases[at(k)]);

    Tensor& rest = scratch.rest;
    for (Index n = 0; n < modes; ++n) {
        const Index first = n == 0 ? 1 : 0;
        contract(executor, rows, old, residual, first, now.bases[at(first)], rest);
        for (Index q = 0; q < modes; ++q) {
            if (q == n || q == first) continue;
            mode_product(executor, rest, q, now.bases[at(q)], Op::kTranspose, scratch.other);
            std::swap(rest, scratch.other);
        }
        const Index rank = std::min(shape[at(n)], rows.shape()[at(n)]);
        now.bases[at(n)] = leading_basis(gram(executor, rest, n), rank);
    }
    mode_product(executor, rest, modes - 1, now.bases.back(), Op::kTranspose, now.core);
    pad(executor, shape, now.bases, now.core);
    exchange(executor, rows, old, now, residual);

    std::copy_n(now.core.data(), now.core.size(), state.cores[at(c)].data());
    std::copy_n(now.core.data(), now.core.size(), state.spread(c));
    for (Index k = 0; k < modes; ++k) state.bases[at(c)][at(k)] = std::move(now.bases[at(k)]);
}

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

// One mode is clustered, and others have bases.
void update_one(Executor& executor, ClusterState& state, Index c, Tensor& residual,
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

}  // namespace

bool can_update_in_place(const ClusterState& state) {
    const bool others = std::any_of(state.ranks().begin() + state.clustered(), state.ranks().end(),
                                    [](Index r) { return r > 0; });
    return state.clustered() == 1 ? others : !others;
}

void update_in_place(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch) {
    const auto update = state.clustered() == 1 ? update_one : update_several;
    update(executor, state, c, residual, scratch);
}

}  // namespace nacre
