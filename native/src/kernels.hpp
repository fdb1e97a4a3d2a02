// Inner loops of our own, where those of a BLAS would first copy their operands into another order:
// for operands that are in a core's cache already, and narrow, that takes as long as the product.
#pragma once

#include <cstdint>

namespace nacre {

struct Kernels {
    // c (m x n, row stride ldc) = a b, or c + a b with `add`. a(i, k) is a[i * a_row + k *
    // a_column]; b is depth x n with row stride ldb.
    void (*product)(std::int64_t m, std::int64_t n, std::int64_t depth, const float* a,
                    std::int64_t a_row, std::int64_t a_column, const float* b, std::int64_t ldb,
                    bool add, float* c, std::int64_t ldc);

    // The upper triangle of sum (rows x rows) += x x^T, x being rows x columns with row stride ldx.
    // Products are added up in float over at most 784 columns.
    void (*gram)(std::int64_t rows, std::int64_t columns, const float* x, std::int64_t ldx,
                 double* sum);

    // sum (m x n, row stride lds) += x y^T; x is m x columns and y n x columns with row strides ldx
    // and ldy. Products are added up in float over at most 528 columns.
    void (*inner)(std::int64_t m, std::int64_t n, std::int64_t columns, const float* x,
                  std::int64_t ldx, const float* y, std::int64_t ldy, double* sum,
                  std::int64_t lds);

    // c[i] = the sum over k of weights[k * m + i] b[k], or c[i] + it with `add`, for m <= 4 rows of
    // n: b is read once, wherever its rows lie.
    void (*rows)(std::int64_t m, std::int64_t n, std::int64_t depth, const float* weights,
                 const float* const* b, bool add, float* const* c);
};

// The best that this processor can run; null if there are none for it.
const Kernels* kernels();

extern const Kernels kKernelsAvx2, kKernelsAvx512;

}  // namespace nacre
