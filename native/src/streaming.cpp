#include "nacre/streaming.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "nacre/gram.hpp"
#include "projection_pass.hpp"

namespace nacre {

namespace {

std::vector<Index> front_order(Index modes, Index first) {
    std::vector<Index> order(at(modes));
    std::iota(order.begin(), order.end(), Index{0});
    std::rotate(order.begin(), order.begin() + first, order.begin() + first + 1);
    return order;
}

// Where element (i_0, i_1, ...) of the source's modes lies in a tensor whose modes are in `order`.
Shape strides_of(const Shape& source_shape, const std::vector<Index>& order) {
    Shape strides(source_shape.size());
    Index step = 1;
    for (std::size_t k = order.size(); k-- > 0;) {
        strides[at(order[k])] = step;
        step *= source_shape[at(order[k])];
    }
    return strides;
}

// Writes a C-order block into a tensor with these strides.
void store(const float* block, const Shape& begin, Shape size, Shape strides, float* out) {
    for (std::size_t n = 0; n < size.size(); ++n) out += begin[n] * strides[n];
    // Modes that lie one after the other there too are one.
    for (std::size_t n = size.size() - 1; n-- > 0;) {
        if (strides[n] != strides[n + 1] * size[n + 1]) continue;
        size[n] *= size[n + 1];
        strides[n] = strides[n + 1];
        size.erase(size.begin() + static_cast<std::ptrdiff_t>(n) + 1);
        strides.erase(strides.begin() + static_cast<std::ptrdiff_t>(n) + 1);
    }
    const Index length = size.back(), step = strides.back();
    const Index runs = product(size) / length;
    Shape position(size.size(), 0);
    for (Index run = 0; run < runs; ++run) {
        float* to = out;
        for (std::size_t n = 0; n + 1 < size.size(); ++n) to += position[n] * strides[n];
        const float* from = block + run * length;
        if (step == 1) {
            std::copy_n(from, length, to);
        } else {
            for (Index i = 0; i < length; ++i) to[i * step] = from[i];
        }
        for (std::size_t n = size.size() - 1; n-- > 0;) {
            if (++position[n] < size[n]) break;
            position[n] = 0;
        }
    }
}

Bases one_basis(const TensorSource& source, Index mode, const MatrixF& basis) {
    Bases bases(source.shape().size(), nullptr);
    bases[at(mode)] = &basis;
    return bases;
}

Bases padded(const TensorSource& source, Bases bases) {
    bases.resize(source.shape().size(), nullptr);
    return bases;
}

}  // namespace

Shape front_shape(const Shape& shape, Index first) {
    Shape moved = shape;
    std::rotate(moved.begin(), moved.begin() + first, moved.begin() + first + 1);
    return moved;
}

Tensor move_to_front(Executor& executor, const Tensor& tensor, Index first) {
    return load(executor, MemorySource(tensor), first);
}

MatrixD gram(Executor& executor, const TensorSource& source, Index mode, const Bases& bases) {
    const ProjectionPass pass(source, padded(source, bases), mode);
    const Index slabs = slab_count(pass.blocks());
    std::vector<MatrixD> partial(at(slabs));
    std::vector<ProjectionPass::Scratch> scratch(at(executor.threads()));
    executor.parallel_for(
        slabs,
        [&](Index slab, int worker) {
            GramSum sum(source.shape()[at(mode)]);
            Shape begin, size;
            const Index end = (slab + 1) * pass.blocks() / slabs;
            for (Index i = slab * pass.blocks() / slabs; i < end; ++i) {
                const float* block = pass.run(i, scratch[at(worker)], begin, size);
                sum.add(block, unfolding(size, mode));
            }
            partial[at(slab)] = sum.finish();
        },
        true);
    MatrixD total = std::move(partial[0]);
    for (Index slab = 1; slab < slabs; ++slab) total += partial[at(slab)];
    if (!std::isfinite(total.trace())) source.throw_invalid();
    symmetrise(total);
    return total;
}

Tensor project(Executor& executor, const TensorSource& source, const Bases& bases,
               const std::vector<Index>& order, const Workspace& workspace) {
    const ProjectionPass pass(source, padded(source, bases), -1);
    const Shape& natural = pass.result_shape();
    const std::vector<Index> modes =
        order.empty() ? front_order(static_cast<Index>(natural.size()), 0) : order;
    Shape shape;
    for (Index mode : modes) shape.push_back(natural[at(mode)]);
    const Shape strides = strides_of(natural, modes);
    Tensor out = workspace.tensor(shape);
    std::vector<ProjectionPass::Scratch> scratch(at(executor.threads()));
    executor.parallel_for(
        pass.blocks(),
        [&](Index task, int worker) {
            Shape begin, size;
            const float* block = pass.run(task, scratch[at(worker)], begin, size);
            store(block, begin, size, strides, out.data());
        },
        true);
    return out;
}

Tensor project(Executor& executor, const TensorSource& source, Index mode, const MatrixF& basis,
               Index first, const Workspace& workspace) {
    return project(executor, source, one_basis(source, mode, basis),
                   front_order(static_cast<Index>(source.shape().size()), first), workspace);
}

Tensor load(Executor& executor, const TensorSource& source, Index first,
            const Workspace& workspace) {
    return project(executor, source, Bases{},
                   front_order(static_cast<Index>(source.shape().size()), first), workspace);
}

}  // namespace nacre
