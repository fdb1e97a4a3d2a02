#include "thin_product.hpp"

#include <algorithm>
#include <vector>

#include "kernels.hpp"

namespace nacre {

namespace {

constexpr Index kPart = 512;
constexpr Index kRows = 4;  // of c at a time

// Up to four rows of c from k rows of b; weights are k x m.
void few_rows(Index m, Index n, Index k, const float* weights, const float* const* b, bool add,
              float* const* c) {
    if (const Kernels* own = kernels()) return own->rows(m, n, k, weights, b, add, c);
    for (Index r = 0; r < m; ++r) {
        if (!add) std::fill_n(c[r], n, 0.0f);
        for (Index j = 0; j < k; ++j) {
            const float w = weights[j * m + r];
            for (Index i = 0; i < n; ++i) c[r][i] += w * b[j][i];
        }
    }
}

}  // namespace

void thin_product(Index m, Index n, Index k, const float* weights, const float* const* b, bool add,
                  float* const* c) {
    std::vector<float> packed(at(m * k));  // each group of rows k x its height
    for (Index i = 0; i < m; i += kRows) {
        const Index height = std::min(kRows, m - i);
        float* to = packed.data() + i * k;
        for (Index j = 0; j < k; ++j) {
            for (Index r = 0; r < height; ++r) *to++ = weights[(i + r) * k + j];
        }
    }
    // A part of b for all rows of c: with few rows it stays in the first cache.
    const Index part = m > kRows ? kPart : n;
    std::vector<const float*> rows(at(k));
    for (Index first = 0; first < n; first += part) {
        const Index count = std::min(part, n - first);
        for (Index j = 0; j < k; ++j) rows[at(j)] = b[j] + first;
        for (Index i = 0; i < m; i += kRows) {
            const Index height = std::min(kRows, m - i);
            float* to[kRows];
            for (Index r = 0; r < height; ++r) to[r] = c[i + r] + first;
            few_rows(height, count, k, packed.data() + i * k, rows.data(), add, to);
        }
    }
}

void thin_product(Index m, Index n, Index k, float alpha, const float* a, Index row_step,
                  Index column_step, const float* b, Index ldb, bool add, float* c, Index ldc) {
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
    thin_product(m, n, k, weights.data(), from.data(), add, to.data());
}

}  // namespace nacre
