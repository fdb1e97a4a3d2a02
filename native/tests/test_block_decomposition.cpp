// N-SVD of one cluster's members against plain alternating least squares.
#include "block_decomposition.hpp"
#include "dense_clusters.hpp"

using namespace nacre;

namespace {

dense::Array approximation(const std::vector<MatrixF>& bases, const Tensor& core) {
    dense::Array result(core);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (bases[n].size() == 0) continue;
        result = dense::mode_product(result, n, bases[n].cast<double>());
    }
    return result;
}

// From the truncated HOSVD, then again from where that ends; the first `clustered` modes may have
// fewer rows than their rank.
void check_block(const Shape& shape, Index clustered, const std::vector<Index>& ranks, int sweeps) {
    Executor executor(2), alone(1);
    const Tensor block = random_tensor(shape, 17);
    const dense::Array array(block);
    const double scale = std::sqrt(array.squared_norm());
    BlockDecomposition decomposition;
    std::vector<MatrixF> bases(shape.size());
    Tensor core;
    decomposition.run(executor, block, clustered, ranks, sweeps, bases, core);

    std::vector<MatrixD> expected_bases;
    const dense::Array expected = dense::nsvd(array, ranks, sweeps, expected_bases);
    CHECK(dense::distance(approximation(bases, core), expected) < 1e-4 * scale);
    for (std::size_t n = 0; n < shape.size(); ++n) {
        CHECK(core.shape()[n] == (ranks[n] > 0 ? ranks[n] : shape[n]));
        CHECK(bases[n].cols() == ranks[n]);
        if (ranks[n] == 0) continue;
        CHECK(
            dense::has_orthonormal_columns(bases[n].cast<double>(), std::min(ranks[n], shape[n])));
    }

    // One more sweep. What the clustering stage leaves in the bases of clustered modes is not
    // orthonormal: only their span matters (the post-process).
    std::vector<MatrixF> skewed = bases;
    std::vector<MatrixD> orthonormal(shape.size());
    for (std::size_t n = 0; n < shape.size(); ++n) {
        orthonormal[n] = bases[n].cast<double>();
        if (static_cast<Index>(n) < clustered) {
            skewed[n] = random_matrix(shape[n], ranks[n], 40 + n);
            orthonormal[n] = dense::orthonormal(skewed[n].cast<double>());
        }
    }
    std::vector<MatrixF> same = skewed;
    Tensor same_core = core;
    decomposition.run(executor, block, clustered, ranks, 1, skewed, core);
    BlockDecomposition().run(alone, block, clustered, ranks, 1, same, same_core);
    CHECK(skewed == same);  // no trace of what it was used for before, nor of the threads
    const dense::Array next = dense::nsvd(array, ranks, 1, orthonormal);
    CHECK(dense::distance(approximation(skewed, core), next) < 1e-4 * scale);
}

}  // namespace

int main() {
    check_block({7, 5, 6}, 1, {3, 2, 4}, 1);
    check_block({7, 5, 6}, 1, {3, 2, 4}, 2);
    check_block({7, 5, 6}, 2, {3, 2, 0}, 1);  // a mode in full
    check_block({7, 5, 6}, 1, {3, 0, 0}, 3);  // nothing but the first mode
    check_block({7, 5, 6}, 3, {3, 2, 4}, 1);  // every mode clustered
    check_block({4, 5, 3, 4}, 2, {2, 3, 2, 3}, 2);
    check_block({4, 5, 3, 4}, 2, {2, 3, 0, 3}, 1);
    check_block({4, 5, 3, 4}, 4, {2, 3, 2, 3}, 1);
    // Fewer members than the rank, one member; a rank that the others cannot fill.
    check_block({2, 5, 6}, 1, {3, 2, 4}, 1);
    check_block({5, 2, 6}, 2, {3, 3, 4}, 1);
    check_block({1, 2, 6, 3}, 2, {2, 4, 3, 0}, 2);
    check_block({1, 1, 6}, 3, {2, 2, 1}, 1);
    check_block({3, 4, 300}, 2, {2, 2, 0}, 1);  // a wide block

    // Coefficients that do not fill their rank: no column is lost, none is NaN. All zero: the same.
    Executor executor(2);
    const Tensor block = random_tensor({5, 6, 4}, 3);
    for (Index zero : {1, 3}) {
        std::vector<MatrixF> bases{random_matrix(5, 3, 1), random_matrix(6, 3, 2),
                                   random_matrix(4, 2, 3)};
        bases[1].rightCols(zero).setZero();
        Tensor core = random_tensor({3, 3, 2}, 4);
        BlockDecomposition().run(executor, block, 2, {3, 3, 2}, 1, bases, core);
        for (const MatrixF& u : bases) CHECK(orthonormality_error(u) < 1e-5);
        CHECK(core.shape() == Shape({3, 3, 2}));
    }
    std::puts("ok");
}
