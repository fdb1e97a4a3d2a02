#include "check.hpp"
#include "nacre/blas.hpp"
#include "nacre/gram.hpp"
#include "nacre/streaming.hpp"

using namespace nacre;

int main() {
    Executor executor(2), alone(1);
    const std::vector<Shape> shapes = {{3, 4, 5, 2}, {1, 7, 1, 3}, {6}, {7, 30, 200}, {9000, 6}};
    for (const Shape& shape : shapes) {
        const Tensor tensor = random_tensor(shape, 2);
        const MemorySource source(tensor.data(), shape);
        for (std::size_t n = 0; n < shape.size(); ++n) {
            if (shape[n] > 1000) continue;  // the long mode is there for the others
            const Index mode = static_cast<Index>(n);
            const MatrixD unfolded = dense::unfold(dense::Array(tensor), n);
            const MatrixD expected = unfolded * unfolded.transpose();
            const MatrixD in_memory = gram(executor, tensor, mode);
            const MatrixD streamed = gram(executor, source, mode);
            const double scale = expected.diagonal().maxCoeff();
            CHECK((in_memory - expected).cwiseAbs().maxCoeff() < 1e-6 * scale);
            CHECK((streamed - expected).cwiseAbs().maxCoeff() < 1e-6 * scale);
            CHECK(gram(alone, tensor, mode) == in_memory);
            CHECK(gram(alone, source, mode) == streamed);

            // The basis: orthonormal, by falling eigenvalue, the largest entry positive.
            const Index rank = (shape[n] + 1) / 2;
            const MatrixF basis = leading_basis(in_memory, rank);
            CHECK(orthonormality_error(basis) < 1e-6);
            double last = 1e300;
            for (Index r = 0; r < rank; ++r) {
                const VectorD u = basis.col(r).cast<double>();
                const double value = u.dot(expected * u);
                CHECK(value <= last + 1e-6 * scale);
                last = value;
                CHECK((expected * u - value * u).norm() < 1e-5 * scale);
                Index largest;
                u.cwiseAbs().maxCoeff(&largest);
                CHECK(u(largest) > 0);
            }
        }
    }
    Tensor bad = random_tensor({4, 5}, 1);
    bad.data()[7] = NAN;
    CHECK(!message_of([&] { gram(executor, MemorySource(bad.data(), {4, 5}), 0); }).empty());

    // Eigenvalues of a matrix known in closed form: 2 - 2 cos(k pi / (n + 1)).
    MatrixD chain = MatrixD::Zero(9, 9);
    for (Index i = 0; i < 9; ++i) {
        chain(i, i) = 2;
        if (i) chain(i, i - 1) = chain(i - 1, i) = -1;
    }
    MatrixD vectors = chain;
    const VectorD values = symmetric_eigen(vectors);
    for (Index k = 0; k < 9; ++k) {
        CHECK_NEAR(values(k), 2 - 2 * std::cos((k + 1) * M_PI / 10), 1e-12);
        const VectorD v = vectors.row(k);
        CHECK((chain * v - values(k) * v).norm() < 1e-12);
    }

    // Only the leading ones: few, for which there is another way, and many; equal eigenvalues.
    const MatrixD random = random_matrix(70, 90, 3).cast<double>();
    for (const MatrixD& matrix :
         {MatrixD(random * random.transpose()), MatrixD(MatrixD::Identity(70, 70)),
          MatrixD(MatrixD::Zero(70, 70)), MatrixD(MatrixD::Ones(70, 70)), chain,
          MatrixD(MatrixD::Constant(1, 1, 3))}) {
        const Index n = matrix.rows();
        MatrixD all = matrix;
        const VectorD expected = symmetric_eigen(all);
        const double scale = std::max(1.0, expected(n - 1));
        for (Index count : {Index{0}, Index{1}, Index{4}, Index{8}, Index{9}, Index{40}, n}) {
            if (count > n) continue;
            MatrixD upper = matrix.triangularView<Eigen::Upper>(), found;
            const VectorD some = leading_eigen(upper, count, found);
            CHECK(some.size() == count && found.rows() == count);
            if (count > 0) CHECK(orthonormality_error(found.transpose().cast<float>()) < 1e-6);
            for (Index k = 0; k < count; ++k) {
                CHECK_NEAR(some(k), expected(n - 1 - k), 1e-12 * scale);
                const VectorD v = found.row(k);
                CHECK((matrix * v - some(k) * v).norm() < 1e-12 * scale);
            }
        }
    }
    std::puts("ok");
}
