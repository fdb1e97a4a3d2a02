#include "nacre/blas.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "nacre/errors.hpp"
#include "thin_product.hpp"

// The scipy-openblas32 build prefixes every symbol, so that it can live beside another BLAS.
extern "C" {
void scipy_cblas_sgemm(int order, int trans_a, int trans_b, int m, int n, int k, float alpha,
                       const float* a, int lda, const float* b, int ldb, float beta, float* c,
                       int ldc);
void scipy_cblas_dgemm(int order, int trans_a, int trans_b, int m, int n, int k, double alpha,
                       const double* a, int lda, const double* b, int ldb, double beta, double* c,
                       int ldc);
void scipy_cblas_ssyrk(int order, int uplo, int trans, int n, int k, float alpha, const float* a,
                       int lda, float beta, float* c, int ldc);
void scipy_dsyevd_(const char* jobz, const char* uplo, const int* n, double* a, const int* lda,
                   double* w, double* work, const int* lwork, int* iwork, const int* liwork,
                   int* info, std::size_t, std::size_t);
void scipy_openblas_set_num_threads(int threads);
}

namespace nacre {

namespace {

constexpr int kRowMajor = 101, kNoTrans = 111, kTrans = 112, kUpper = 121;

int blas_op(Op op) { return op == Op::kNone ? kNoTrans : kTrans; }

int narrow(Index value) {
    require(value <= std::numeric_limits<int>::max(), "matrix extent ", value, " is too large");
    return static_cast<int>(value);
}

// A leading dimension may not be 0 even where the matrix is empty.
int stride(Index value) { return std::max(narrow(value), 1); }

// The copy of OpenBLAS is our own: its threads would only get in the way of ours.
[[maybe_unused]] const bool kSingleThreaded = [] {
    scipy_openblas_set_num_threads(1);
    return true;
}();

}  // namespace

void gemm(Op op_a, Op op_b, Index m, Index n, Index k, float alpha, const float* a, Index lda,
          const float* b, Index ldb, float beta, float* c, Index ldc) {
    if (m == 0 || n == 0) return;
    if (op_b == Op::kNone && is_thin(m, n)) {
        const bool plain = op_a == Op::kNone;
        thin_product(m, n, k, alpha, a, plain ? lda : 1, plain ? 1 : lda, b, ldb, beta, c, ldc);
        return;
    }
    scipy_cblas_sgemm(kRowMajor, blas_op(op_a), blas_op(op_b), narrow(m), narrow(n), narrow(k),
                      alpha, a, stride(lda), b, stride(ldb), beta, c, stride(ldc));
}

void gemm(Op op_a, Op op_b, Index m, Index n, Index k, double alpha, const double* a, Index lda,
          const double* b, Index ldb, double beta, double* c, Index ldc) {
    if (m == 0 || n == 0) return;
    scipy_cblas_dgemm(kRowMajor, blas_op(op_a), blas_op(op_b), narrow(m), narrow(n), narrow(k),
                      alpha, a, stride(lda), b, stride(ldb), beta, c, stride(ldc));
}

void syrk_upper(Op op_a, Index n, Index k, const float* a, Index lda, float beta, float* c,
                Index ldc) {
    if (n == 0) return;
    scipy_cblas_ssyrk(kRowMajor, kUpper, blas_op(op_a), narrow(n), narrow(k), 1.0f, a, stride(lda),
                      beta, c, stride(ldc));
}

VectorD symmetric_eigen(MatrixD& matrix) {
    const int n = narrow(matrix.rows());
    VectorD values(n);
    if (n == 0) return values;
    // Column-major for LAPACK: its lower triangle is our upper one, and its columns our rows.
    int info = 0, int_size = -1, integer = 0;
    int size = -1;
    double optimum = 0;
    scipy_dsyevd_("V", "L", &n, matrix.data(), &n, values.data(), &optimum, &size, &integer,
                  &int_size, &info, 1, 1);
    size = static_cast<int>(optimum);
    int_size = integer;
    std::vector<double> work(at(size));
    std::vector<int> int_work(at(int_size));
    scipy_dsyevd_("V", "L", &n, matrix.data(), &n, values.data(), work.data(), &size,
                  int_work.data(), &int_size, &info, 1, 1);
    if (info != 0) throw std::runtime_error("eigenvalue iteration did not converge");
    return values;
}

}  // namespace nacre
