#include "residual_rows.hpp"

#include <algorithm>

#include "block_decomposition.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "thin_product.hpp"

namespace nacre {

namespace {

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

// The core expanded by these matrices over the clustered modes; null leaves a mode alone.
void expand(Executor& executor, const Tensor& core, Bases bases, Tensor& result, Tensor& scratch) {
    bases.resize(core.shape().size(), nullptr);
    multi_mode_product(executor, core, bases, Op::kNone, result, scratch);
}

// result = (residual + what the cluster adds) x_mode U^T over its members.
void contract(Executor& executor, const Rows& rows, const Part& part, const Tensor& residual,
              Index mode, const MatrixF& basis, Tensor& result, Tensor& scratch) {
    const Index columns = part.core.dim(part.core.order() - 1);
    const MatrixF change = basis.transpose() * part.bases[at(mode)];
    Bases bases;
    for (const MatrixF& u : part.bases) bases.push_back(&u);
    bases[at(mode)] = &change;
    expand(executor, part.core, std::move(bases), result, scratch);
    const MatrixF weights = basis.transpose();
    const Index inner = unfolding(rows.shape(), mode).inner, rank = basis.cols();
    executor.parallel_for(rows.slices(mode), [&](Index slice, int) {
        const auto from = rows.along(residual.data(), mode, slice);
        std::vector<float*> to;
        for (Index r = 0; r < rank; ++r) {
            const Index row = (slice / inner * rank + r) * inner + slice % inner;
            to.push_back(result.data() + row * columns);
        }
        thin_product(rank, columns, basis.rows(), weights.data(), from.data(), true, to.data());
    });
}

// residual += one part - another.
void exchange(Executor& executor, const Rows& rows, const Part& out, const Part& in,
              Tensor& residual, ResidualScratch& scratch) {
    const Index last = static_cast<Index>(out.bases.size()) - 1;
    const Index columns = out.core.dim(out.core.order() - 1);
    const auto expand_all_but_last = [&](const Part& part, Tensor& result) {
        Bases bases;
        for (Index k = 0; k < last; ++k) bases.push_back(&part.bases[at(k)]);
        expand(executor, part.core, std::move(bases), result, scratch.other);
    };
    expand_all_but_last(out, scratch.before);
    expand_all_but_last(in, scratch.after);
    const MatrixF &u = out.bases[at(last)], &v = in.bases[at(last)];
    const Index rank = u.cols();
    MatrixF weights(u.rows(), 2 * rank);
    weights << u, -v;
    executor.parallel_for(rows.slices(last), [&](Index slice, int) {
        std::vector<const float*> from;
        for (const Tensor* part : {&scratch.before, &scratch.after}) {
            for (Index r = 0; r < rank; ++r) {
                from.push_back(part->data() + (slice * rank + r) * columns);
            }
        }
        const auto to = rows.along(residual.data(), last, slice);
        thin_product(u.rows(), columns, 2 * rank, weights.data(), from.data(), true, to.data());
    });
}

}  // namespace

bool has_clustered_bases_alone(const ClusterState& state) {
    return state.clustered() > 1 &&
           std::all_of(state.ranks().begin() + state.clustered(), state.ranks().end(),
                       [](Index r) { return r == 0; });
}

void update_in_place(Executor& executor, ClusterState& state, Index c, Tensor& residual,
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
        contract(executor, rows, old, residual, first, now.bases[at(first)], rest, scratch.other);
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
    exchange(executor, rows, old, now, residual, scratch);

    std::copy_n(now.core.data(), now.core.size(), state.cores[at(c)].data());
    std::copy_n(now.core.data(), now.core.size(), state.spread(c));
    for (Index k = 0; k < modes; ++k) state.bases[at(c)][at(k)] = std::move(now.bases[at(k)]);
}

}  // namespace nacre
