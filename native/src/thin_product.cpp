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

// Four rows of c from k rows of b; weights are k x 4.
NACRE_EACH_WIDTH
void four_rows(Index n, Index k, const float* weights, const float* const* b, float beta,
               float* const* c) {
    Index first = 0;
    for (; first + kColumns <= n; first += kColumns) {
        float sum[kRows][kColumns] = {};
        for (Index j = 0; j < k; ++j) {
            const float* row = b[j] + first;
            const float* w = weights + j * kRows;
            NACRE_PREFETCH(row + 4 * kColumns);
            for (Index r = 0; r < kRows; ++r) {
                for (Index i = 0; i < kColumns; ++i) sum[r][i] += w[r] * row[i];
            }
        }
        for (Index r = 0; r < kRows; ++r) {
            float* to = c[r] + first;
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
            for (Index j = 0; j < k; ++j) sum += weights[j * kRows + r] * b[j][first];
            float& to = c[r][first];
            to = beta == 0 ? sum : beta * to + sum;
        }
    }
}

}  // namespace

void thin_product(Index m, Index n, Index k, const float* weights, const float* const* b,
                  float beta, float* const* c) {
    const Index groups = (m + kRows - 1) / kRows;
    std::vector<float> group_weights(at(groups * k * kRows), 0.0f);
    for (Index i = 0; i < m; ++i) {
        float* group = group_weights.data() + i / kRows * k * kRows;
        for (Index j = 0; j < k; ++j) group[j * kRows + i % kRows] = weights[i * k + j];
    }
    std::vector<const float*> rows(at(k));
    float nothing[kPart] = {};  // a row that c does not have
    // A part of b for all rows of c: with few rows it stays in the first cache.
    for (Index first = 0; first < n; first += kPart) {
        const Index count = std::min(kPart, n - first);
        for (Index j = 0; j < k; ++j) rows[at(j)] = b[j] + first;
        for (Index group = 0; group < groups; ++group) {
            float* to[kRows];
            for (Index r = 0; r < kRows; ++r) {
                const Index i = group * kRows + r;
                to[r] = i < m ? c[i] + first : nothing;
            }
            four_rows(count, k, group_weights.data() + group * k * kRows, rows.data(), beta, to);
        }
    }
}

void thin_product(Index m, Index n, Index k, float alpha, const float* a, Index row_step,
                  Index column_step, const float* b, Index ldb, float beta, float* c, Index ldc) {
    std::vector<float> weights(at(m * k));
    std::vector<const float*> from(at(k));
    std::vector<float*> to(at(m));
    for (Index i = 0; i < m; ++i) {
        to[at(i)] = c + i * ldc;
        for (Index j = 0; j < k; ++j) {
            weights[at(i * k + j)] = alpha * a[i * row_step + j * column_step];
        }
    }
    for (Index j = 0; j < k; ++j) from[at(j)] = b + j * ldb;
    thin_product(m, n, k, weights.data(), from.data(), beta, to.data());
}

}  // namespace nacre
