#include "decomposition_stage.hpp"

#include <algorithm>

#include "block_decomposition.hpp"
#include "in_place_update.hpp"
#include "nacre/blas.hpp"
#include "nacre/mode_product.hpp"

namespace nacre {

namespace {

constexpr Index kTileFloats = 1 << 15;  // columns of one row that are handled at a time, at most

// Clusters that share no element may be decomposed at the same time (Section 3.6): batches of
// such, in order. The result does not depend on how a batch is run.
std::vector<std::vector<Index>> batches_of(const ClusterState& state) {
    std::vector<std::vector<Index>> batches;
    for (Index c = 0; c < state.count(); ++c) {
        const auto fits = [&](const std::vector<Index>& batch) {
            return std::none_of(batch.begin(), batch.end(),
                                [&](Index other) { return state.overlap(c, other); });
        };
        const auto found = std::find_if(batches.begin(), batches.end(), fits);
        if (found != batches.end()) {
            found->push_back(c);
        } else {
            batches.push_back({c});
        }
    }
    return batches;
}

}  // namespace

// What one thread needs to decompose a cluster.
class DecompositionStage::Cluster {
  public:
    Cluster() : alone(1) {}
    Executor alone;
    BlockDecomposition decomposition;
    Tensor block, a, b;
    ResidualScratch in_place;
    std::vector<Index> offsets;  // of each row of the block in the tensor, in rows
};

DecompositionStage::DecompositionStage(Executor& executor, const Workspace& workspace,
                                       ClusterState& state)
    : executor_(executor), workspace_(workspace), state_(state) {
    for (int i = 0; i < executor.threads(); ++i) scratch_.push_back(std::make_unique<Cluster>());
}

DecompositionStage::~DecompositionStage() = default;

void spread_core(Executor& executor, ClusterState& state, Index c, Tensor& a, Tensor& b) {
    std::vector<const MatrixF*> bases(state.shape().size(), nullptr);
    for (std::size_t n = at(state.clustered()); n < bases.size(); ++n) {
        if (state.bases[at(c)][n].size() > 0) bases[n] = &state.bases[at(c)][n];
    }
    multi_mode_product(executor, state.cores[at(c)], bases, Op::kNone, a, b);
    std::copy_n(a.data(), a.size(), state.spread(c));
}

namespace {

// block += sign * Z_c x_n U_n,c, each row of the block being taken from and returned to where
// `begin` and `end` say: begin(row, first, count, values), before and after the product.
template <class Begin, class End>
void add_approximation(Executor& executor, const ClusterState& state, Index c, float sign,
                       float* block, Tensor& a, Tensor& b, Begin&& begin, End&& end) {
    const Index modes = state.clustered(), columns = state.columns();
    const Index last = modes - 1;
    // Every clustered mode but the last is expanded first.
    Shape shape;
    for (Index n = 0; n < modes; ++n) shape.push_back(state.groupings[at(n)].rank);
    shape.push_back(columns);
    const float* cores = state.spread(c);
    if (modes > 1) {
        Tensor *from = &a, *to = &b;
        from->reset(shape);
        std::copy_n(state.spread(c), from->size(), from->data());
        for (Index n = 0; n < last; ++n) {
            mode_product(executor, *from, n, state.bases[at(c)][at(n)], Op::kNone, *to);
            shape[at(n)] = to->dim(n);
            std::swap(from, to);
        }
        cores = from->data();
    }
    const MatrixF& basis = state.bases[at(c)][at(last)];
    const Index rows = basis.rows(), rank = basis.cols();
    Index slices = 1;
    for (Index n = 0; n < last; ++n) slices *= state.bases[at(c)][at(n)].rows();
    const Index tile =
        std::min(columns, std::max<Index>(64, kTileFloats / std::max<Index>(rows, 1)));
    const Index tiles = (columns + tile - 1) / tile;
    executor.parallel_for(slices * tiles, [&](Index task, int) {
        const Index slice = task / tiles, first = task % tiles * tile;
        const Index count = std::min(tile, columns - first);
        float* piece = block + slice * rows * columns + first;
        for (Index i = 0; i < rows; ++i) begin(slice * rows + i, first, count, piece + i * columns);
        gemm(Op::kNone, Op::kNone, rows, count, rank, sign, basis.data(), rank,
             cores + slice * rank * columns + first, columns, 1.0f, piece, columns);
        for (Index i = 0; i < rows; ++i) end(slice * rows + i, first, count, piece + i * columns);
    });
}

}  // namespace

void DecompositionStage::update(Executor& executor, Cluster& scratch, Tensor& residual, Index c,
                                int sweeps) {
    const bool first_time = state_.cores[at(c)].size() == 0;
    if (!first_time && sweeps == 1 && can_update_in_place(state_)) {
        update_in_place(executor, state_, c, residual, scratch.in_place);
        return;
    }
    const Index modes = state_.clustered(), columns = state_.columns();
    Shape shape = state_.shape();
    Index rows = 1;
    for (Index k = 0; k < modes; ++k) {
        shape[at(k)] = static_cast<Index>(state_.members(c, k).size());
        rows *= shape[at(k)];
    }
    if (rows == 0) return;
    scratch.offsets.assign(at(rows), 0);
    for (Index row = 0; row < rows; ++row) {
        Index rest = row, stride = 1, offset = 0;
        for (Index k = modes; k-- > 0;) {
            offset += state_.members(c, k)[at(rest % shape[at(k)])] * stride;
            rest /= shape[at(k)];
            stride *= state_.groupings[at(k)].rows;
        }
        scratch.offsets[at(row)] = offset;
    }
    if (workspace_.bounded()) {
        scratch.block = Tensor();
        scratch.block = workspace_.tensor(shape);
    } else {
        scratch.block.reset(shape);
    }
    float* block = scratch.block.data();
    const auto take = [&](Index row, Index first, Index count, float* values) {
        std::copy_n(residual.data() + scratch.offsets[at(row)] * columns + first, count, values);
    };
    const auto give = [&](Index row, Index first, Index count, const float* values) {
        std::copy_n(values, count, residual.data() + scratch.offsets[at(row)] * columns + first);
    };
    const auto nothing = [](Index, Index, Index, const float*) {};

    // Eq. 12: with its own part back, the residual is what the other clusters leave over.
    if (first_time) {
        executor.parallel_for(
            rows, [&](Index row, int) { take(row, 0, columns, block + row * columns); });
    } else {
        add_approximation(executor, state_, c, 1.0f, block, scratch.a, scratch.b, take, nothing);
    }
    scratch.decomposition.run(executor, scratch.block, modes, state_.ranks(), sweeps,
                              state_.bases[at(c)], state_.cores[at(c)]);
    spread_core(executor, state_, c, scratch.a, scratch.b);
    add_approximation(executor, state_, c, -1.0f, block, scratch.a, scratch.b, nothing, give);
    scratch.block.drop();
}

void DecompositionStage::run(Tensor& residual, int sweeps) {
    for (const std::vector<Index>& batch : batches_of(state_)) {
        if (static_cast<int>(batch.size()) >= executor_.threads() && !workspace_.bounded()) {
            executor_.parallel_for(static_cast<Index>(batch.size()), [&](Index i, int worker) {
                Cluster& scratch = *scratch_[at(worker)];
                update(scratch.alone, scratch, residual, batch[at(i)], sweeps);
            });
        } else {
            for (Index c : batch) {
                update(executor_, *scratch_[0], residual, c, sweeps);
                residual.drop();
                state_.spreads().drop();
            }
        }
    }
}

}  // namespace nacre
