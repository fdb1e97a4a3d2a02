#include "nacre/mode_product.hpp"

#include <algorithm>
#include <numeric>

namespace nacre {

namespace {

// Enough arithmetic to hide the cost of handing out a task, little enough to balance the load.
constexpr Index kTaskFlops = 4'000'000;

Index divide_up(Index a, Index b) { return (a + b - 1) / b; }

// op(U) of one slice: (new rows) x (rows) times (rows) x inner, part of `inner` columns wide.
void multiply_slice(const float* in, Index rows, Index inner, Index columns, const MatrixF& basis,
                    Op op, float* out) {
    const Index new_rows = op == Op::kTranspose ? basis.cols() : basis.rows();
    gemm(op, Op::kNone, new_rows, columns, rows, 1.0f, basis.data(), basis.cols(), in, inner, 0.0f,
         out, inner);
}

// The last mode: one matrix of outer x rows, multiplied from the right.
void multiply_rows(const float* in, Index outer, Index rows, const MatrixF& basis, Op op,
                   float* out) {
    const Index new_rows = op == Op::kTranspose ? basis.cols() : basis.rows();
    gemm(Op::kNone, op == Op::kTranspose ? Op::kNone : Op::kTranspose, outer, new_rows, rows, 1.0f,
         in, rows, basis.data(), basis.cols(), 0.0f, out, new_rows);
}

}  // namespace

void mode_product(const float* in, const Unfolding& view, const MatrixF& basis, Op op, float* out) {
    const auto [outer, rows, inner] = view;
    if (inner == 1) {
        multiply_rows(in, outer, rows, basis, op, out);
        return;
    }
    const Index new_rows = op == Op::kTranspose ? basis.cols() : basis.rows();
    for (Index o = 0; o < outer; ++o) {
        multiply_slice(in + o * rows * inner, rows, inner, inner, basis, op,
                       out + o * new_rows * inner);
    }
}

void mode_product(Executor& executor, const Tensor& in, Index mode, const MatrixF& basis, Op op,
                  Tensor& out) {
    const Unfolding view = unfolding(in.shape(), mode);
    const auto [outer, rows, inner] = view;
    const Index new_rows = op == Op::kTranspose ? basis.cols() : basis.rows();
    Shape shape = in.shape();
    shape[at(mode)] = new_rows;
    out.reset(std::move(shape));
    const float* source = in.data();
    float* destination = out.data();

    const Index column_flops = std::max<Index>(1, 2 * rows * new_rows);
    if (inner == 1) {
        const Index chunk =
            std::clamp<Index>(kTaskFlops / column_flops, 64, std::max<Index>(64, outer));
        executor.parallel_for(divide_up(outer, chunk), [&](Index task, int) {
            const Index first = task * chunk, count = std::min(chunk, outer - first);
            multiply_rows(source + first * rows, count, rows, basis, op,
                          destination + first * new_rows);
        });
    } else if (column_flops * inner <= kTaskFlops) {
        const Index chunk = kTaskFlops / (column_flops * inner);
        executor.parallel_for(divide_up(outer, chunk), [&](Index task, int) {
            const Index first = task * chunk, count = std::min(chunk, outer - first);
            mode_product(source + first * rows * inner, {count, rows, inner}, basis, op,
                         destination + first * new_rows * inner);
        });
    } else {
        const Index chunk = std::max<Index>(256, kTaskFlops / column_flops);
        const Index chunks = divide_up(inner, chunk);
        executor.parallel_for(outer * chunks, [&](Index task, int) {
            const Index o = task / chunks, first = (task % chunks) * chunk;
            multiply_slice(source + o * rows * inner + first, rows, inner,
                           std::min(chunk, inner - first), basis, op,
                           destination + o * new_rows * inner + first);
        });
    }
}

void multi_mode_product(Executor& executor, const Tensor& in,
                        const std::vector<const MatrixF*>& bases, Op op, Tensor& out,
                        Tensor& scratch) {
    std::vector<std::size_t> modes;
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (bases[n]) modes.push_back(n);
    }
    std::stable_sort(modes.begin(), modes.end(), [&](std::size_t a, std::size_t b) {
        const auto ratio = [&](std::size_t n) {
            const double shrink = static_cast<double>(bases[n]->cols()) / bases[n]->rows();
            return op == Op::kTranspose ? shrink : 1 / shrink;
        };
        return ratio(a) < ratio(b);
    });
    if (modes.empty()) {
        out = in;
        return;
    }
    // The last product lands in `out`.
    const Tensor* from = &in;
    Tensor* to = modes.size() % 2 ? &out : &scratch;
    for (std::size_t n : modes) {
        mode_product(executor, *from, static_cast<Index>(n), *bases[n], op, *to);
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
