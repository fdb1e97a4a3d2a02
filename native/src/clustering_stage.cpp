#include "clustering_stage.hpp"

#include <algorithm>
#include <functional>

#include "kronecker.hpp"
#include "nacre/blas.hpp"
#include "nacre/gram.hpp"
#include "thin_product.hpp"

namespace nacre {

namespace {

constexpr Index kSpreadFloats = 1 << 21;  // of the cores of all clusters in one tile: last cache
constexpr Index kMaxColumns = 4096;       // of one tile

Index divide_up(Index a, Index b) { return (a + b - 1) / b; }

// A slice of mode k is one row of each other clustered mode; its stack are the clusters that it is
// mixed from, cut down to that row: their rows span what the slice's rows of mode k may be.
class Stacks {
  public:
    Stacks(const ClusterState& state, Index k) : state_(state), k_(k) {
        const Grouping& own = state.groupings[at(k)];
        for (Index q = 0; q < state.clustered(); ++q) {
            if (q == k) continue;
            const Grouping& other = state.groupings[at(q)];
            slices_ *= other.rows;
            mixtures_ *= other.mixtures;
            other_rank_ *= other.rank;
        }
        for (Index q = 0; q < k; ++q) before_ *= state.groupings[at(q)].rank;
        after_ = other_rank_ / before_;
        width_ = own.count * mixtures_ * own.rank;
        const Index spread = state.count() * state.core_rows();
        tile_ = std::clamp<Index>(kSpreadFloats / spread / 64 * 64, 64, kMaxColumns);
        tile_ = std::min(tile_, state.columns());
    }

    Index slices() const { return slices_; }
    Index width() const { return width_; }  // rows of a stack
    Index tile() const { return tile_; }
    Index tiles() const { return divide_up(state_.columns(), tile_); }

    struct Slice {
        Index offset = 0;            // of its first row of mode k in the tensor, in rows
        Index step = 0;              // from one row of mode k to the next, in rows
        std::vector<Index> owners;   // of mode k, one for each combination of mixtures
        std::vector<float> weights;  // owners x clusters of mode k x other ranks
    };

    void slice(Index number, Slice& result) const {
        const Index modes = state_.clustered();
        const Index count = state_.groupings[at(k_)].count;
        std::vector<Index> row(at(modes), 0);
        result.offset = 0;
        result.step = 1;
        Index stride = 1;
        for (Index q = modes; q-- > 0;) {
            const Index rows = state_.groupings[at(q)].rows;
            if (q == k_) {
                result.step = stride;
            } else {
                row[at(q)] = number % rows;
                number /= rows;
                result.offset += row[at(q)] * stride;
            }
            stride *= rows;
        }
        result.owners.resize(at(mixtures_));
        result.weights.resize(at(mixtures_ * count * other_rank_));
        float* weights = result.weights.data();
        for (Index e = 0; e < mixtures_; ++e) {
            Index rest = e, owner = 0, scale = 1;
            std::vector<Index> position(at(modes), 0);
            for (Index q = modes; q-- > 0;) {
                if (q == k_) continue;
                const Grouping& other = state_.groupings[at(q)];
                const Index slot = rest % other.mixtures;
                rest /= other.mixtures;
                owner += scale * other.of_row(row[at(q)])[slot];
                scale *= other.count;
                position[at(q)] = other.position[at(row[at(q)] * other.mixtures + slot)];
            }
            result.owners[at(e)] = owner;
            for (Index part = 0; part < count; ++part) {
                const Index c = state_.cluster(part, owner, k_);
                // The Kronecker product of the basis rows, last mode fastest.
                Index size = 1;
                weights[0] = 1;
                for (Index q = 0; q < modes; ++q) {
                    if (q == k_) continue;
                    const Index rank = state_.groupings[at(q)].rank;
                    const float* u = state_.bases[at(c)][at(q)].data() + position[at(q)] * rank;
                    kronecker(weights, size, u, rank);
                    size *= rank;
                }
                weights += other_rank_;
            }
        }
    }

    // Rows [owner][cluster of mode k][rank] of the stack at these columns, count wide, into `out`
    // unless they lie in memory like that already.
    const float* rows(const Slice& slice, Index first, Index count, Index& stride,
                      Buffer& out) const {
        const Grouping& own = state_.groupings[at(k_)];
        if (other_rank_ == 1 && mixtures_ == 1 && state_.clustered() == 1) {
            stride = state_.columns();
            return state_.spread(0) + first;
        }
        out.reserve(width_ * tile_);
        stride = count;
        float* to = out.data();
        const float* weights = slice.weights.data();
        for (Index owner : slice.owners) {
            for (Index part = 0; part < own.count; ++part, weights += other_rank_) {
                const float* core = state_.spread(state_.cluster(part, owner, k_)) + first;
                combine(core, weights, count, to);
                to += own.rank * count;
            }
        }
        return out.data();
    }

    // Where in the columns of the products each block of rank rows of a stack goes.
    void blocks(const Slice& slice, std::vector<Index>& columns) const {
        const Grouping& own = state_.groupings[at(k_)];
        columns.clear();
        for (Index owner : slice.owners) {
            for (Index part = 0; part < own.count; ++part) {
                columns.push_back((part * state_.owners(k_) + owner) * own.rank);
            }
        }
    }

  private:
    // The rows of one core, summed over the ranks of the other clustered modes.
    void combine(const float* core, const float* weights, Index count, float* to) const {
        const Index rank = state_.groupings[at(k_)].rank, columns = state_.columns();
        // As a product with a (rank x core rows) matrix that is mostly zero.
        const Index core_rows = state_.core_rows();
        thread_local std::vector<float> spread;
        spread.assign(at(rank * core_rows), 0.0f);
        for (Index r = 0; r < rank; ++r) {
            for (Index o = 0; o < other_rank_; ++o) {
                const Index row = (o / after_ * rank + r) * after_ + o % after_;
                spread[at(r * core_rows + row)] = weights[o];
            }
        }
        thin_product(rank, count, core_rows, 1.0f, spread.data(), core_rows, 1, core, columns,
                     false, to, count);
    }

    const ClusterState& state_;
    Index k_;
    Index slices_ = 1, mixtures_ = 1, other_rank_ = 1, before_ = 1, after_ = 1, width_ = 1;
    Index tile_ = 1;
};

}  // namespace

MatrixD spread_gram(Executor& executor, const ClusterState& state) {
    const Index width = state.count() * state.core_rows(), columns = state.columns();
    // Blocks of rows, so that threads write apart from each other.
    const Index block = std::min<Index>(width, 128), blocks = divide_up(width, block);
    MatrixD result = MatrixD::Zero(width, width);
    executor.parallel_for(blocks * blocks, [&](Index task, int) {
        const Index i = task / blocks * block, j = task % blocks * block;
        if (j < i) return;
        const Index rows = std::min(block, width - i), others = std::min(block, width - j);
        add_inner_products(rows, others, columns, state.spread(0) + i * columns, columns,
                           state.spread(0) + j * columns, columns, result.data() + i * width + j,
                           width);
        if (j > i) {
            result.block(j, i, others, rows) = result.block(i, j, rows, others).transpose();
        }
    });
    return result;
}

MatrixD subset_gram(Executor& executor, const ClusterState& state, Index k,
                    const MatrixD& spread_gram) {
    const Grouping& own = state.groupings[at(k)];
    const Index rank = own.rank, owners = state.owners(k), core_rows = state.core_rows();
    Index before = 1, after = 1;
    for (Index q = 0; q < state.clustered(); ++q) {
        if (q < k) before *= state.groupings[at(q)].rank;
        if (q > k) after *= state.groupings[at(q)].rank;
    }
    const Index other = before * after;
    MatrixD gram = MatrixD::Zero(own.count * owners * rank, own.count * owners * rank);
    executor.parallel_for(state.count(), [&](Index c, int) {
        for (Index d = c; d < state.count(); ++d) {
            // U_n,c^T U_n,d over the other clustered modes: their Kronecker product.
            MatrixD cross = MatrixD::Ones(1, 1);
            for (Index q = 0; q < state.clustered() && cross.size() > 0; ++q) {
                if (q == k) continue;
                const std::vector<Index>&rows = state.members(c, q), &others = state.members(d, q);
                const MatrixF &u = state.bases[at(c)][at(q)], &v = state.bases[at(d)][at(q)];
                MatrixD product = MatrixD::Zero(u.cols(), v.cols());
                bool common = false;
                for (std::size_t i = 0, j = 0; i < rows.size() && j < others.size();) {
                    if (rows[i] != others[j]) {
                        rows[i] < others[j] ? ++i : ++j;
                        continue;
                    }
                    product += u.row(static_cast<Index>(i++)).cast<double>().transpose() *
                               v.row(static_cast<Index>(j++)).cast<double>();
                    common = true;
                }
                if (!common) {
                    cross.resize(0, 0);
                    break;
                }
                MatrixD next(cross.rows() * product.rows(), cross.cols() * product.cols());
                for (Index i = 0; i < cross.rows(); ++i) {
                    for (Index j = 0; j < cross.cols(); ++j) {
                        next.block(i * product.rows(), j * product.cols(), product.rows(),
                                   product.cols()) = cross(i, j) * product;
                    }
                }
                cross = std::move(next);
            }
            if (cross.size() == 0) continue;
            const Index row = (state.part(c, k) * owners + state.owner(c, k)) * rank;
            const Index column = (state.part(d, k) * owners + state.owner(d, k)) * rank;
            const auto core_row = [&](Index r, Index o) {
                return (o / after * rank + r) * after + o % after;
            };
            for (Index r = 0; r < rank; ++r) {
                for (Index s = 0; s < rank; ++s) {
                    double sum = 0;
                    for (Index o = 0; o < other; ++o) {
                        const double* from = spread_gram.data() +
                                             (c * core_rows + core_row(r, o)) * spread_gram.cols() +
                                             d * core_rows;
                        for (Index p = 0; p < other; ++p) {
                            sum += cross(o, p) * from[core_row(s, p)];
                        }
                    }
                    gram(row + r, column + s) = sum;
                }
            }
        }
    });
    for (Index c = 0; c < state.count(); ++c) {
        const Index row = (state.part(c, k) * owners + state.owner(c, k)) * rank;
        for (Index d = c + 1; d < state.count(); ++d) {
            const Index column = (state.part(d, k) * owners + state.owner(d, k)) * rank;
            gram.block(column, row, rank, rank) = gram.block(row, column, rank, rank).transpose();
        }
    }
    return gram;
}

MatrixD subset_projections(Executor& executor, const ClusterState& state, Index k,
                           const Tensor& tensor) {
    const Stacks stacks(state, k);
    const Grouping& own = state.groupings[at(k)];
    const Index rows = own.rows, width = stacks.width(), columns = state.columns();
    const Index total = stacks.tiles() * stacks.slices();
    const Index slabs = std::min<Index>(slab_count(total), 16);
    std::vector<MatrixD> partial(at(slabs));
    executor.parallel_for(slabs, [&](Index slab, int) {
        MatrixD sum = MatrixD::Zero(rows, own.count * state.owners(k) * own.rank);
        MatrixD piece(rows, width);
        Buffer buffer;
        Stacks::Slice slice;
        std::vector<Index> blocks;
        for (Index i = slab * total / slabs; i < (slab + 1) * total / slabs; ++i) {
            const Index first = i / stacks.slices() * stacks.tile();
            const Index count = std::min(stacks.tile(), columns - first);
            stacks.slice(i % stacks.slices(), slice);
            Index stride = 0;
            const float* stack = stacks.rows(slice, first, count, stride, buffer);
            piece.setZero();
            add_inner_products(rows, width, count, tensor.data() + slice.offset * columns + first,
                               slice.step * columns, stack, stride, piece.data(), width);
            stacks.blocks(slice, blocks);
            for (Index row = 0; row < rows; ++row) {
                const double* from = piece.data() + row * width;
                double* to = sum.data() + row * sum.cols();
                for (Index block : blocks) {
                    for (Index r = 0; r < own.rank; ++r) to[block + r] += *from++;
                }
            }
        }
        partial[at(slab)] = std::move(sum);
    });
    MatrixD result = std::move(partial[0]);
    for (Index slab = 1; slab < slabs; ++slab) result += partial[at(slab)];
    tensor.drop();
    return result;
}

void residual(Executor& executor, const ClusterState& state, const Tensor& tensor,
              Tensor& residual) {
    // Along the mode whose stacks are the smallest.
    Index k = 0;
    for (Index q = 1; q < state.clustered(); ++q) {
        if (Stacks(state, q).width() < Stacks(state, k).width()) k = q;
    }
    const Stacks stacks(state, k);
    const Grouping& own = state.groupings[at(k)];
    const Index rows = own.rows, width = stacks.width(), columns = state.columns();
    struct Scratch {
        Buffer stack;
        MatrixF mixing;
        Stacks::Slice slice;
    };
    std::vector<Scratch> scratch(at(executor.threads()));
    executor.parallel_for(stacks.tiles() * stacks.slices(), [&](Index task, int worker) {
        auto& [buffer, mixing, slice] = scratch[at(worker)];
        const Index first = task / stacks.slices() * stacks.tile();
        const Index count = std::min(stacks.tile(), columns - first);
        stacks.slice(task % stacks.slices(), slice);
        Index stride = 0;
        const float* stack = stacks.rows(slice, first, count, stride, buffer);
        mixing.setZero(rows, width);
        Index column = 0;
        for (Index owner : slice.owners) {
            for (Index part = 0; part < own.count; ++part, column += own.rank) {
                const Index c = state.cluster(part, owner, k);
                const std::vector<Index>& members = state.members(c, k);
                const MatrixF& basis = state.bases[at(c)][at(k)];
                for (std::size_t i = 0; i < members.size(); ++i) {
                    std::transform(basis.data() + static_cast<Index>(i) * own.rank,
                                   basis.data() + static_cast<Index>(i + 1) * own.rank,
                                   mixing.data() + members[i] * width + column,
                                   std::negate<float>());
                }
            }
        }
        const Index step = slice.step * columns;
        const float* from = tensor.data() + slice.offset * columns + first;
        float* to = residual.data() + slice.offset * columns + first;
        for (Index row = 0; row < rows; ++row)
            std::copy_n(from + row * step, count, to + row * step);
        gemm(Op::kNone, Op::kNone, rows, count, width, 1.0f, mixing.data(), width, stack, stride,
             1.0f, to, step);
    });
    tensor.drop();
    residual.drop();
}

}  // namespace nacre
