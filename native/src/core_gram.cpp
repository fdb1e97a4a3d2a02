#include "nacre/core_gram.hpp"

#include "nacre/blas.hpp"

namespace nacre {

MatrixD core_gram(Executor& executor, const std::vector<Tensor>& cores,
                  const std::vector<std::vector<MatrixF>>& bases, Index clustered) {
    const Index count = static_cast<Index>(cores.size());
    const Index rank = cores[0].dim(clustered);
    const Index order = cores[0].order();
    MatrixD result(count * rank, count * rank);
    const auto basis = [&](Index n, Index c) -> const MatrixF& {
        return bases[at(n)].size() == 1 ? bases[at(n)][0] : bases[at(n)][at(c)];
    };
    executor.parallel_for(
        count * count,
        [&](Index task, int) {
            const Index j = task / count, c = task % count;
            if (c < j) return;
            // Z_j^(c) = Z_j x_n (U_n,c^T U_n,j) over the modes but m (Eq. 14).
            const Tensor& from = cores[at(j)];
            std::vector<double> values(from.data(), from.data() + from.size()), next;
            Shape shape = from.shape();
            for (Index n = 0; n < order; ++n) {
                if (n == clustered) continue;
                const MatrixD change =
                    basis(n, c).cast<double>().transpose() * basis(n, j).cast<double>();
                const auto [outer, rows, inner] = unfolding(shape, n);
                shape[at(n)] = change.rows();
                next.resize(at(product(shape)));
                for (Index o = 0; o < outer; ++o) {
                    gemm(Op::kNone, Op::kNone, change.rows(), inner, rows, 1.0, change.data(), rows,
                         values.data() + o * rows * inner, inner, 0.0,
                         next.data() + o * change.rows() * inner, inner);
                }
                std::swap(values, next);
            }
            const Tensor& to = cores[at(c)];
            const auto [outer, rows, inner] = unfolding(shape, clustered);
            MatrixD block = MatrixD::Zero(rank, rank);
            for (Index o = 0; o < outer; ++o) {
                const Eigen::Map<const MatrixD> left(values.data() + o * rows * inner, rows, inner);
                const Eigen::Map<const MatrixF> right(to.data() + o * rows * inner, rows, inner);
                block += left * right.cast<double>().transpose();
            }
            result.block(j * rank, c * rank, rank, rank) = block;
            result.block(c * rank, j * rank, rank, rank) = block.transpose();
        },
        true);
    return result;
}

}  // namespace nacre
