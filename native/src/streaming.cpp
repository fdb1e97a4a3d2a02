#include "nacre/streaming.hpp"

#include <algorithm>
#include <cmath>

#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"

namespace nacre {

namespace {

constexpr Index kBlockFloats = 1 << 18;  // 1 MiB: with its products, about a core's second cache

// Cuts a tensor into blocks that hold the modes in `whole` in full.
class BlockGrid {
  public:
    BlockGrid(const TensorSource& source, const std::vector<bool>& whole)
        : shape_(source.shape()), chunk_(shape_) {
        Index floats = 1;
        for (std::size_t n = 0; n < shape_.size(); ++n) {
            if (!whole[n]) chunk_[n] = source.granularity(static_cast<Index>(n));
            floats *= chunk_[n];
        }
        // Grow from the last mode on, for long contiguous runs; then even the chunks out.
        for (std::size_t n = shape_.size(); n-- > 0;) {
            if (whole[n]) continue;
            const Index grain = chunk_[n];
            const Index grains = shape_[n] / grain;
            const Index fit = std::clamp<Index>(kBlockFloats / floats, 1, grains);
            const Index count = (grains + fit - 1) / fit;
            floats /= grain;
            chunk_[n] = grain * ((grains + count - 1) / count);
            floats *= chunk_[n];
        }
        for (std::size_t n = 0; n < shape_.size(); ++n) {
            counts_.push_back((shape_[n] + chunk_[n] - 1) / chunk_[n]);
        }
    }

    Index size() const { return product(counts_); }
    Index block_floats() const { return product(chunk_); }

    void block(Index number, Shape& begin, Shape& size) const {
        begin.resize(shape_.size());
        size.resize(shape_.size());
        for (std::size_t n = shape_.size(); n-- > 0;) {
            begin[n] = number % counts_[n] * chunk_[n];
            number /= counts_[n];
            size[n] = std::min(chunk_[n], shape_[n] - begin[n]);
        }
    }

  private:
    Shape shape_, chunk_, counts_;
};

std::vector<bool> only(const TensorSource& source, Index mode) {
    std::vector<bool> whole(source.shape().size(), false);
    if (mode >= 0) whole[at(mode)] = true;
    return whole;
}

// Writes a C-order block into `out`, whose mode order is that of the block with `first` in front.
void store_in_front(const float* block, const Shape& begin, const Shape& size, Index first,
                    Tensor& out) {
    // One subtensor of the mode at a time: it is a block of `out` with one row in front.
    const auto [outer, rows, inner] = unfolding(size, first);
    const Shape front_begin = front_shape(begin, first), front_size = front_shape(size, first);
    if (first == 0) {
        copy_in(block, begin, size, out.shape(), out.data());
        return;
    }
    std::vector<float> slice(at(outer * inner));
    for (Index row = 0; row < rows; ++row) {
        for (Index o = 0; o < outer; ++o) {
            std::copy_n(block + (o * rows + row) * inner, inner, slice.data() + o * inner);
        }
        Shape slice_begin = front_begin, slice_size = front_size;
        slice_begin[0] += row;
        slice_size[0] = 1;
        copy_in(slice.data(), slice_begin, slice_size, out.shape(), out.data());
    }
}

}  // namespace

Shape front_shape(const Shape& shape, Index first) {
    Shape moved = shape;
    std::rotate(moved.begin(), moved.begin() + first, moved.begin() + first + 1);
    return moved;
}

Tensor move_to_front(Executor& executor, const Tensor& tensor, Index first) {
    return load(executor, MemorySource(tensor.data(), tensor.shape()), first);
}

MatrixD gram(Executor& executor, const TensorSource& source, Index mode) {
    const BlockGrid grid(source, only(source, mode));
    const Index slabs = slab_count(grid.size());
    std::vector<MatrixD> partial(at(slabs));
    std::vector<Buffer> blocks(at(executor.threads()));
    executor.parallel_for(
        slabs,
        [&](Index slab, int worker) {
            Buffer& block = blocks[at(worker)];
            block.reserve(grid.block_floats());
            GramSum sum(source.shape()[at(mode)]);
            Shape begin, size;
            for (Index i = slab * grid.size() / slabs; i < (slab + 1) * grid.size() / slabs; ++i) {
                grid.block(i, begin, size);
                source.read(begin, size, block.data());
                sum.add(block.data(), unfolding(size, mode));
            }
            partial[at(slab)] = sum.finish();
        },
        true);
    MatrixD total = partial[0];
    for (Index slab = 1; slab < slabs; ++slab) total += partial[at(slab)];
    if (!std::isfinite(total.trace())) source.throw_invalid();
    symmetrise(total);
    return total;
}

Tensor project(Executor& executor, const TensorSource& source, Index mode, const MatrixF& basis,
               Index first) {
    const BlockGrid grid(source, only(source, mode));
    Shape shape = source.shape();
    shape[at(mode)] = basis.cols();
    Tensor out(front_shape(shape, first));
    std::vector<Buffer> blocks(at(executor.threads())), products(at(executor.threads()));
    executor.parallel_for(
        grid.size(),
        [&](Index task, int worker) {
            Shape begin, size;
            grid.block(task, begin, size);
            Buffer &block = blocks[at(worker)], &result = products[at(worker)];
            block.reserve(grid.block_floats());
            source.read(begin, size, block.data());
            const Unfolding view = unfolding(size, mode);
            begin[at(mode)] = 0;
            size[at(mode)] = basis.cols();
            result.reserve(product(size));
            mode_product(block.data(), view, basis, Op::kTranspose, result.data());
            store_in_front(result.data(), begin, size, first, out);
        },
        true);
    return out;
}

Tensor project_others(Executor& executor, const TensorSource& source, Index lead,
                      const std::vector<const MatrixF*>& bases) {
    const Shape& shape = source.shape();
    const Index order = static_cast<Index>(shape.size());
    // One mode is contracted last, over blocks that hold a few of its rows: the outermost one.
    Index last = -1;
    for (Index n = order - 1; n >= 0; --n) {
        if (bases[at(n)]) last = n;
    }
    if (last < 0) return load(executor, source);

    Shape out_shape = shape;
    for (Index n = 0; n < order; ++n) {
        if (bases[at(n)]) out_shape[at(n)] = bases[at(n)]->cols();
    }
    Tensor out(out_shape);

    const Index grain = source.granularity(lead);
    std::vector<bool> whole(shape.size(), true);
    whole[at(last)] = false;
    struct Scratch {
        Buffer a, b, gathered;
    };
    std::vector<Scratch> scratch(at(executor.threads()));
    // The rows of `last` in a block, for a lead chunk of one grain.
    const Index row_floats = product(shape) / shape[at(lead)] * grain / shape[at(last)];
    const Index last_grain = source.granularity(last);
    const Index step = std::clamp<Index>(kBlockFloats / row_floats / last_grain * last_grain,
                                         last_grain, shape[at(last)]);
    executor.parallel_for(
        shape[at(lead)] / grain,
        [&](Index task, int worker) {
            auto& [a, b, gathered] = scratch[at(worker)];
            Shape gathered_shape = out_shape;  // every mode contracted but `last`
            gathered_shape[at(lead)] = grain;
            gathered_shape[at(last)] = shape[at(last)];
            gathered.reserve(product(gathered_shape));
            Shape begin(shape.size(), 0), size = shape;
            begin[at(lead)] = task * grain;
            size[at(lead)] = grain;
            for (Index row = 0; row < shape[at(last)]; row += step) {
                begin[at(last)] = row;
                size[at(last)] = std::min(step, shape[at(last)] - row);
                Shape block = size;
                a.reserve(product(block));
                source.read(begin, block, a.data());
                for (Index n = order - 1; n > last; --n) {
                    if (!bases[at(n)]) continue;
                    const Unfolding view = unfolding(block, n);
                    block[at(n)] = bases[at(n)]->cols();
                    b.reserve(product(block));
                    mode_product(a.data(), view, *bases[at(n)], Op::kTranspose, b.data());
                    std::swap(a, b);
                }
                Shape position(shape.size(), 0);
                position[at(last)] = row;
                copy_in(a.data(), position, block, gathered_shape, gathered.data());
            }
            Shape result = gathered_shape;
            result[at(last)] = bases[at(last)]->cols();
            b.reserve(product(result));
            mode_product(gathered.data(), unfolding(gathered_shape, last), *bases[at(last)],
                         Op::kTranspose, b.data());
            Shape position(shape.size(), 0);
            position[at(lead)] = task * grain;
            copy_in(b.data(), position, result, out_shape, out.data());
        },
        true);
    return out;
}

Tensor load(Executor& executor, const TensorSource& source, Index first) {
    Tensor out(front_shape(source.shape(), first));
    const BlockGrid grid(source, only(source, -1));
    std::vector<Buffer> blocks(at(executor.threads()));
    executor.parallel_for(
        grid.size(),
        [&](Index task, int worker) {
            Shape begin, size;
            grid.block(task, begin, size);
            Buffer& block = blocks[at(worker)];
            block.reserve(grid.block_floats());
            source.read(begin, size, block.data());
            store_in_front(block.data(), begin, size, first, out);
        },
        true);
    return out;
}

}  // namespace nacre
