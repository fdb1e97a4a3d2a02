#include "check.hpp"
#include "kernels.hpp"

using namespace nacre;

namespace {

void check_product(const Kernels& own, Index m, Index n, Index depth) {
    const MatrixF a = random_matrix(m, depth, 1), b = random_matrix(depth, n + 3, 2);
    const MatrixF transposed = a.transpose();
    const MatrixD expected = a.cast<double>() * b.leftCols(n).cast<double>();
    const double tolerance = 1e-6 * std::sqrt(static_cast<double>(depth));
    const MatrixF before = random_matrix(m, n + 5, 3);
    for (bool add : {false, true}) {
        for (bool from_transposed : {false, true}) {
            MatrixF c = before;
            own.product(m, n, depth, from_transposed ? transposed.data() : a.data(),
                        from_transposed ? 1 : depth, from_transposed ? m : 1, b.data(), n + 3, add,
                        c.data(), n + 5);
            MatrixD result = c.leftCols(n).cast<double>();
            if (add) result -= before.leftCols(n).cast<double>();
            CHECK((result - expected).cwiseAbs().maxCoeff() < tolerance);
            CHECK(c.rightCols(5) == before.rightCols(5));
        }
    }
}

void check_gram(const Kernels& own, Index rows, Index columns) {
    const MatrixF x = random_matrix(rows, columns + 7, 4);
    const MatrixD values = x.leftCols(columns).cast<double>();
    const MatrixD expected = values * values.transpose();
    MatrixD sum = MatrixD::Constant(rows, rows, 2);
    own.gram(rows, columns, x.data(), columns + 7, sum.data());
    for (Index i = 0; i < rows; ++i) {
        for (Index j = i; j < rows; ++j) {
            CHECK_NEAR(sum(i, j) - 2, expected(i, j), 1e-6 * static_cast<double>(columns));
        }
    }
}

void check_inner(const Kernels& own, Index m, Index n, Index columns) {
    const MatrixF x = random_matrix(m, columns + 7, 5), y = random_matrix(n, columns + 2, 6);
    const MatrixD expected =
        x.leftCols(columns).cast<double>() * y.leftCols(columns).cast<double>().transpose();
    MatrixD sum = MatrixD::Constant(m, n + 1, 2);
    own.inner(m, n, columns, x.data(), columns + 7, y.data(), columns + 2, sum.data(), n + 1);
    const MatrixD found = (sum.leftCols(n).array() - 2).matrix();
    CHECK((found - expected).cwiseAbs().maxCoeff() < 1e-6 * static_cast<double>(columns));
    CHECK(sum.col(n) == MatrixD::Constant(m, 1, 2));
}

}  // namespace

int main() {
#if defined(__x86_64__)
    std::vector<const Kernels*> levels;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        levels.push_back(&kKernelsAvx2);
    }
    if (__builtin_cpu_supports("avx512f")) levels.push_back(&kKernelsAvx512);
    for (const Kernels* own : levels) {
        for (Index m : {1, 5, 13, 14, 15, 20, 43, 81}) {
            for (Index n : {1, 7, 8, 15, 16, 17, 31, 32, 33, 70}) {
                for (Index depth : {1, 9, 256, 300}) check_product(*own, m, n, depth);
            }
        }
        for (Index rows : {1, 2, 3, 4, 5, 6, 7, 12, 13, 29, 81}) {
            for (Index columns : {1, 7, 16, 20, 511, 512, 530}) check_gram(*own, rows, columns);
        }
        for (Index m : {1, 3, 6, 7, 20, 81}) {
            for (Index n : {1, 2, 4, 11, 12, 13, 64}) {
                for (Index columns : {1, 16, 500, 1040}) check_inner(*own, m, n, columns);
            }
        }
    }
    CHECK(levels.empty() ? kernels() == nullptr : kernels() == levels.back());
#else
    CHECK(kernels() == nullptr);
#endif
    std::puts("ok");
}
