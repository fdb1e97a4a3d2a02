#include <algorithm>

#include "in_place_update.hpp"
#include "kronecker.hpp"
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
        kronecker(weights, size, factors, u.cols());
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

}  // namespace

void update_several_modes(Executor& executor, ClusterState& state, Index c, Tensor& residual,
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

}  // namespace nacre
