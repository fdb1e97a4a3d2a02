#include "nacre/mode_product.hpp"

#include <algorithm>
#include <numeric>

#include "kernels.hpp"

namespace nacre {

namespace {

// Enough arithmetic to hide the cost of handing out a task, little enough to balance the load.
constexpr Index kTaskFlops = 4'000'000;

Index divide_up(Index a, Index b) { return (a + b - 1) / b; }

// A basis in use: op(U) is `to` x `from`.
struct Factor {
    const float* values;
    Index columns;
    Op op;
    Index to, from;

    Factor(const MatrixF& basis, Op o)
        : values(basis.data()),
          columns(basis.cols()),
          op(o),
          to(o == Op::kTranspose ? basis.cols() : basis.rows()),
          from(o == Op::kTranspose ? basis.rows() : basis.cols()) {}
    Factor(const float* rows, Index count, Index rank)
        : values(rows), columns(rank), op(Op::kTranspose), to(rank), from(count) {}
};

// One slice: op(U) times from x inner, part of `inner` columns wide.
void multiply_slice(const float* in, Index inner, Index columns, const Factor& factor, bool add,
                    float* out) {
    if (const Kernels* own = kernels()) {
        const bool transpose = factor.op == Op::kTranspose;
        own->product(factor.to, columns, factor.from, factor.values, transpose ? 1 : factor.columns,
                     transpose ? factor.columns : 1, in, inner, add, out, inner);
        return;
    }
    gemm(factor.op, Op::kNone, factor.to, columns, factor.from, 1.0f, factor.values, factor.columns,
         in, inner, add ? 1.0f : 0.0f, out, inner);
}

// The last mode: one matrix of outer x from, multiplied from the right.
void multiply_rows(const float* in, Index outer, const Factor& factor, bool add, float* out) {
    const Kernels* own = kernels();
    if (own && factor.op == Op::kTranspose) {
        own->product(outer, factor.to, factor.from, in, factor.from, 1, factor.values,
                     factor.columns, add, out, factor.to);
        return;
    }
    gemm(Op::kNone, factor.op == Op::kTranspose ? Op::kNone : Op::kTranspose, outer, factor.to,
         factor.from, 1.0f, in, factor.from, factor.values, factor.columns, add ? 1.0f : 0.0f, out,
         factor.to);
}

void multiply(const float* in, Index outer, Index inner, const Factor& factor, bool add,
              float* out) {
    if (inner == 1) {
        multiply_rows(in, outer, factor, add, out);
        return;
    }
    for (Index o = 0; o < outer; ++o) {
        multiply_slice(in + o * factor.from * inner, inner, inner, factor, add,
                       out + o * factor.to * inner);
    }
}

}  // namespace

void mode_product(const float* in, const Unfolding& view, const MatrixF& basis, Op op, float* out) {
    multiply(in, view.outer, view.inner, Factor(basis, op), false, out);
}

void contract(const float* in, const Unfolding& view, const float* basis, Index rank, bool add,
              float* out) {
    multiply(in, view.outer, view.inner, Factor(basis, view.rows, rank), add, out);
}

void mode_product(Executor& executor, const Tensor& in, Index mode, const MatrixF& basis, Op op,
                  Tensor& out) {
    const auto [outer, rows, inner] = unfolding(in.shape(), mode);
    // Along the last mode our own loops want the basis with the result's columns side by side.
    const bool turn = inner == 1 && op == Op::kNone && kernels();
    const MatrixF turned = turn ? MatrixF(basis.transpose()) : MatrixF();
    const Factor factor = turn ? Factor(turned, Op::kTranspose) : Factor(basis, op);
    Shape shape = in.shape();
    shape[at(mode)] = factor.to;
    out.reset(std::move(shape));
    const float* source = in.data();
    float* destination = out.data();

    const Index column_flops = std::max<Index>(1, 2 * rows * factor.to);
    if (inner == 1 || column_flops * inner <= kTaskFlops) {
        const Index least = inner == 1 ? 64 : 1;
        const Index chunk = std::max(least, kTaskFlops / (column_flops * inner));
        executor.parallel_for(divide_up(outer, chunk), [&](Index task, int) {
            const Index first = task * chunk;
            multiply(source + first * rows * inner, std::min(chunk, outer - first), inner, factor,
                     false, destination + first * factor.to * inner);
        });
    } else {
        const Index chunk = std::max<Index>(256, kTaskFlops / column_flops);
        const Index chunks = divide_up(inner, chunk);
        executor.parallel_for(outer * chunks, [&](Index task, int) {
            const Index o = task / chunks, first = (task % chunks) * chunk;
            multiply_slice(source + o * rows * inner + first, inner, std::min(chunk, inner - first),
                           factor, false, destination + o * factor.to * inner + first);
        });
    }
}

std::vector<Index> product_order(const Bases& bases, Op op) {
    std::vector<Index> modes;
    for (Index n = 0; n < static_cast<Index>(bases.size()); ++n) {
        if (bases[at(n)]) modes.push_back(n);
    }
    const auto gain = [&](Index n) {
        const Factor factor(*bases[at(n)], op);
        return 1.0 / static_cast<double>(factor.to) - 1.0 / static_cast<double>(factor.from);
    };
    std::stable_sort(modes.begin(), modes.end(),
                     [&](Index a, Index b) { return gain(a) > gain(b); });
    return modes;
}

void multi_mode_product(Executor& executor, const Tensor& in, const Bases& bases, Op op,
                        Tensor& out, Tensor& scratch) {
    const std::vector<Index> modes = product_order(bases, op);
    if (modes.empty()) {
        out = in;
        return;
    }
    // The last product lands in `out`.
    const Tensor* from = &in;
    Tensor* to = modes.size() % 2 ? &out : &scratch;
    for (Index n : modes) {
        mode_product(executor, *from, n, *bases[at(n)], op, *to);
        from = to;
        to = to == &out ? &scratch : &out;
    }
}

double squared_norm(const float* values, Index size) {
    // Eight partial sums, so that the compiler may use vectors without reordering anything else.
    double sums[8] = {};
    Index i = 0;
    for (; i + 8 <= size; i += 8) {
        for (Index k = 0; k < 8; ++k) {
            const double v = values[i + k];
            sums[k] += v * v;
        }
    }
    double total = 0;
    for (double sum : sums) total += sum;
    for (; i < size; ++i) total += static_cast<double>(values[i]) * values[i];
    return total;
}

double squared_norm(Executor& executor, const Tensor& tensor) {
    constexpr Index kChunk = 1 << 18;
    const Index tasks = divide_up(tensor.size(), kChunk);
    std::vector<double> partial(at(tasks));
    executor.parallel_for(tasks, [&](Index task, int) {
        const Index first = task * kChunk;
        partial[at(task)] =
            squared_norm(tensor.data() + first, std::min(kChunk, tensor.size() - first));
    });
    return std::accumulate(partial.begin(), partial.end(), 0.0);
}

}  // namespace nacre
