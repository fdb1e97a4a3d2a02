// Matrix products with a factor of a few rows only, where a general product spends its time on
// packing the other one. This reads that one once, where it lies.
#pragma once

#include "nacre/tensor.hpp"

namespace nacre {

constexpr Index kThin = 8;

// Whether thin_product is the faster way for a product of m x n.
inline bool is_thin(Index m, Index n) { return m <= kThin && n >= 32; }

// c (m x n) = alpha a b, or c + alpha a b with `add`, all row-major; a is m x k with rows and
// columns this far apart.
void thin_product(Index m, Index n, Index k, float alpha, const float* a, Index row_step,
                  Index column_step, const float* b, Index ldb, bool add, float* c, Index ldc);

// The same with rows of b and c that lie anywhere: weights are a, m x k without gaps.
void thin_product(Index m, Index n, Index k, const float* weights, const float* const* b, bool add,
                  float* const* c);

}  // namespace nacre
