// Products with few rows against the sum, element by element.
#include "check.hpp"
#include "nacre/blas.hpp"
#include "thin_product.hpp"

using namespace nacre;

namespace {

// c of `ldc` columns, whose last ones must stay as they are.
void check_product(Index m, Index n, Index k, float alpha, float beta, bool transposed) {
    const Index ldb = n + 3, ldc = n + 2, lda = (transposed ? m : k) + 1;
    const MatrixF a = random_matrix(transposed ? k : m, lda, 1);
    const MatrixF b = random_matrix(k, ldb, 2), before = random_matrix(m, ldc, 3);
    const Index row = transposed ? 1 : lda, column = transposed ? lda : 1;
    MatrixF c = before, by_gemm = before;
    if (beta == 0) c.leftCols(n).setConstant(NAN);  // what is there does not count
    thin_product(m, n, k, alpha, a.data(), row, column, b.data(), ldb, beta == 1, c.data(), ldc);
    gemm(transposed ? Op::kTranspose : Op::kNone, Op::kNone, m, n, k, alpha, a.data(), lda,
         b.data(), ldb, beta, by_gemm.data(), ldc);
    for (Index i = 0; i < m; ++i) {
        for (Index j = 0; j < ldc; ++j) {
            double sum = before(i, j);
            if (j < n) {
                sum *= beta;
                for (Index p = 0; p < k; ++p) {
                    sum += static_cast<double>(alpha) * a.data()[i * row + p * column] * b(p, j);
                }
            }
            CHECK_NEAR(c(i, j), sum, 1e-5);
            CHECK_NEAR(by_gemm(i, j), sum, 1e-5);
        }
    }
}

}  // namespace

int main() {
    for (Index m : {1, 3, 4, 7, 8, 9}) {
        for (Index n : {1, 31, 32, 33, 512, 700}) {
            for (Index k : {1, 5, 40}) {
                check_product(m, n, k, 1, 0, false);
                check_product(m, n, k, -1, 1, false);
                check_product(m, n, k, 0.5f, 1, true);
            }
        }
    }
    check_product(3, 40, 0, 1, 1, false);  // nothing to add
    CHECK(is_thin(8, 32) && !is_thin(9, 32) && !is_thin(8, 31));
    std::puts("ok");
}
