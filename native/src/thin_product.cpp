#include "thin_product.hpp"

#include <algorithm>
#include <vector>

// A loop in every vector width that a processor may have, chosen when the library loads.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__ELF__)
#define NACRE_EACH_WIDTH \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define NACRE_EACH_WIDTH
#endif

#if defined(__GNUC__)
#define NACRE_PREFETCH(address) __builtin_prefetch(address)
#else
#define NACRE_PREFETCH(address)
#endif

namespace nacre {

namespace {

constexpr Index kPart = 512;
constexpr Index kRows = 4;      // of c at a time
constexpr Index kColumns = 32;  // whose sums stay in registers

// Four rows of c from four rows of weights (k x 4).
NACRE_EACH_WIDTH
void four_rows(Index n, Index k, const float* weights, const float* b, Index ldb, float beta,
               float* c, Index ldc) {
    Index first = 0;
    for (; first + kColumns <= n; first += kColumns) {
        float sum[kRows][kColumns] = {};
        const float* row = b + first;
        for (Index j = 0; j < k; ++j, row += ldb) {
            const float* w = weights + j * kRows;
            NACRE_PREFETCH(row + 4 * kColumns);
            for (Index r = 0; r < kRows; ++r) {
                for (Index i = 0; i < kColumns; ++i) sum[r][i] += w[r] * row[i];
            }
        }
        for (Index r = 0; r < kRows; ++r) {
            float* to = c + r * ldc + first;
            if (beta == 0) {
                for (Index i = 0; i < kColumns; ++i) to[i] = sum[r][i];
            } else {
                for (Index i = 0; i < kColumns; ++i) to[i] = beta * to[i] + sum[r][i];
            }
        }
    }
    for (; first < n; ++first) {
        for (Index r = 0; r < kRows; ++r) {
            float sum = 0;
            for (Index j = 0; j < k; ++j) sum += weights[j * kRows + r] * b[j * ldb + first];
            float& to = c[r * ldc + first];
            to = beta == 0 ? sum : beta * to + sum;
        }
    }
}

}  // namespace

void thin_product(Index m, Index n, Index k, float alpha, const float* a, Index row_step,
                  Index column_step, const float* b, Index ldb, float beta, float* c, Index ldc) {
    std::vector<float> weights(at(k * kRows));
    float last[kRows * kPart] = {};  // rows that c does not have
    // A part of b for all rows of c: with few rows it stays in the first cache.
    for (Index first = 0; first < n; first += kPart) {
        const Index count = std::min(kPart, n - first);
        for (Index i = 0; i < m; i += kRows) {
            const Index rows = std::min(kRows, m - i);
            for (Index j = 0; j < k; ++j) {
                for (Index r = 0; r < kRows; ++r) {
                    weights[at(j * kRows + r)] =
                        r < rows ? alpha * a[(i + r) * row_step + j * column_step] : 0.0f;
                }
            }
            float* to = c + i * ldc + first;
            if (rows == kRows) {
                four_rows(count, k, weights.data(), b + first, ldb, beta, to, ldc);
                continue;
            }
            for (Index r = 0; r < rows && beta != 0; ++r) {
                std::copy_n(to + r * ldc, count, last + r * kPart);
            }
            four_rows(count, k, weights.data(), b + first, ldb, beta, last, kPart);
            for (Index r = 0; r < rows; ++r) std::copy_n(last + r * kPart, count, to + r * ldc);
        }
    }
}

}  // namespace nacre
