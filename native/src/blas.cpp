#include "nacre/blas.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "kernels.hpp"
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
void scipy_dsytrd_(const char* uplo, const int* n, double* a, const int* lda, double* d, double* e,
                   double* tau, double* work, const int* lwork, int* info, std::size_t);
void scipy_dstemr_(const char* jobz, const char* range, const int* n, double* d, double* e,
                   const double* vl, const double* vu, const int* il, const int* iu, int* m,
                   double* w, double* z, const int* ldz, const int* nzc, int* isuppz, int* tryrac,
                   double* work, const int* lwork, int* iwork, const int* liwork, int* info,
                   std::size_t, std::size_t);
void scipy_dstedc_(const char* compz, const int* n, double* d, double* e, double* z, const int* ldz,
                   double* work, const int* lwork, int* iwork, const int* liwork, int* info,
                   std::size_t);
void scipy_dormtr_(const char* side, const char* uplo, const char* trans, const int* m,
                   const int* n, const double* a, const int* lda, const double* tau, double* c,
                   const int* ldc, double* work, const int* lwork, int* info, std::size_t,
                   std::size_t, std::size_t);
void scipy_dgesdd_(const char* jobz, const int* m, const int* n, double* a, const int* lda,
                   double* s, double* u, const int* ldu, double* vt, const int* ldvt, double* work,
                   const int* lwork, int* iwork, int* info, std::size_t);
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
    if (op_b == Op::kNone && (beta == 0 || beta == 1)) {
        const Index row = op_a == Op::kNone ? lda : 1, column = op_a == Op::kNone ? 1 : lda;
        if (is_thin(m, n)) {
            thin_product(m, n, k, alpha, a, row, column, b, ldb, beta == 1, c, ldc);
            return;
        }
        if (const Kernels* own = kernels(); own && alpha == 1 && k > 0) {
            own->product(m, n, k, a, row, column, b, ldb, beta == 1, c, ldc);
            return;
        }
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

namespace {

// A symmetric tridiagonal matrix; its `count` largest eigenvalues, ascending, and their vectors one
// after the other.
struct Tridiagonal {
    VectorD diagonal, beside;  // n and n - 1 (and one to spare)

    // By relatively robust representations, which finds any few of them. False if it fails.
    bool some(int count, VectorD& values, std::vector<double>& vectors) const {
        const int n = static_cast<int>(diagonal.size()), from = n - count + 1;
        const int size = 18 * n, int_size = 10 * n;
        std::vector<double> work(at(size));
        std::vector<int> int_work(at(int_size)), support(2 * at(count));
        VectorD d = diagonal, e = beside, all(n);
        vectors.resize(at(n) * at(count));
        const double unused = 0;
        int found = 0, precise = 1, info = 0;
        scipy_dstemr_("V", "I", &n, d.data(), e.data(), &unused, &unused, &from, &n, &found,
                      all.data(), vectors.data(), &n, &count, support.data(), &precise, work.data(),
                      &size, int_work.data(), &int_size, &info, 1, 1);
        values = all.head(count);
        return info == 0 && found == count;
    }

    // By divide and conquer, all of them.
    void every(int count, VectorD& values, std::vector<double>& vectors) const {
        const int n = static_cast<int>(diagonal.size());
        const int size = 1 + 4 * n + n * n, int_size = 3 + 5 * n;
        std::vector<double> work(at(size)), all(at(n) * at(n));
        std::vector<int> int_work(at(int_size));
        VectorD d = diagonal, e = beside;
        int info = 0;
        scipy_dstedc_("I", &n, d.data(), e.data(), all.data(), &n, work.data(), &size,
                      int_work.data(), &int_size, &info, 1);
        if (info != 0) throw std::runtime_error("eigenvalue iteration did not converge");
        values = d.tail(count);
        vectors.assign(all.end() - static_cast<std::ptrdiff_t>(n) * count, all.end());
    }
};

}  // namespace

VectorD leading_eigen(MatrixD& matrix, Index count, MatrixD& vectors) {
    const int n = narrow(matrix.rows()), k = narrow(count);
    vectors.resize(k, n);
    if (k == 0) return {};
    Tridiagonal tridiagonal{VectorD(n), VectorD(n)};
    VectorD reflectors(n);
    const int size = 64 * n;
    std::vector<double> work(at(size));
    int info = 0;
    // As above: column-major, so the lower triangle is our upper one, and columns are rows.
    scipy_dsytrd_("L", &n, matrix.data(), &n, tridiagonal.diagonal.data(),
                  tridiagonal.beside.data(), reflectors.data(), work.data(), &size, &info, 1);
    VectorD values;
    std::vector<double> found;
    // Up to so many, some cost less than all.
    if (8 * k > n || !tridiagonal.some(k, values, found)) tridiagonal.every(k, values, found);
    scipy_dormtr_("L", "L", "N", &n, &k, matrix.data(), &n, reflectors.data(), found.data(), &n,
                  work.data(), &size, &info, 1, 1, 1);
    for (int r = 0; r < k; ++r) {
        vectors.row(r) = Eigen::Map<const VectorD>(found.data() + at(k - 1 - r) * at(n), n);
    }
    return values.reverse();
}

VectorD singular_vectors(MatrixD& matrix, MatrixD& right) {
    const int n = narrow(matrix.rows());
    VectorD values(n);
    right.resize(n, n);
    if (n == 0) return values;
    // Column-major for LAPACK, which sees the transpose: its left vectors are our right ones.
    MatrixD left(n, n);
    std::vector<int> int_work(8 * at(n));
    int info = 0, size = -1;
    double optimum = 0;
    for (std::vector<double> work; size != 0;) {
        double* room = size < 0 ? &optimum : work.data();
        scipy_dgesdd_("A", &n, &n, matrix.data(), &n, values.data(), right.data(), &n, left.data(),
                      &n, room, &size, int_work.data(), &info, 1);
        size = size < 0 ? static_cast<int>(optimum) : 0;
        work.resize(at(size));
    }
    if (info != 0) throw std::runtime_error("singular value iteration did not converge");
    matrix = left;
    return values;
}

}  // namespace nacre
