// The loops of kernels.hpp, for a vector type `Vector` that the including file defines. These files
// are compiled for processors of their own: nothing but intrinsics may come in here, as an inline
// function of the standard library that is compiled here may end up in the rest of the program.

namespace nacre {
namespace {

using Int = std::int64_t;

constexpr Int kWidth = Vector::kWidth;

inline Int least(Int a, Int b) { return a < b ? a : b; }

// kRows x (up to 2 vectors) of the product; the last vector has `tail` columns if kMasked.
template <int kRows, int kVectors, bool kMasked>
inline void product_tile(Int depth, const float* a, Int a_row, Int a_column, const float* b,
                         Int ldb, bool add, float* c, Int ldc, Int tail) {
    const Vector::Mask mask = Vector::first(tail);
    Vector::Type sum[kRows][kVectors];
#pragma GCC unroll 16
    for (int i = 0; i < kRows; ++i) {
#pragma GCC unroll 2
        for (int v = 0; v < kVectors; ++v) sum[i][v] = Vector::zero();
    }
    for (Int k = 0; k < depth; ++k) {
        Vector::Type right[kVectors];
#pragma GCC unroll 2
        for (int v = 0; v < kVectors; ++v) {
            const float* from = b + k * ldb + v * kWidth;
            right[v] = kMasked && v + 1 == kVectors ? Vector::load(from, mask) : Vector::load(from);
        }
#pragma GCC unroll 16
        for (int i = 0; i < kRows; ++i) {
            const Vector::Type left = Vector::broadcast(a[i * a_row + k * a_column]);
#pragma GCC unroll 2
            for (int v = 0; v < kVectors; ++v) {
                sum[i][v] = Vector::multiply_add(left, right[v], sum[i][v]);
            }
        }
    }
#pragma GCC unroll 16
    for (int i = 0; i < kRows; ++i) {
#pragma GCC unroll 2
        for (int v = 0; v < kVectors; ++v) {
            float* to = c + i * ldc + v * kWidth;
            if (kMasked && v + 1 == kVectors) {
                if (add) sum[i][v] = Vector::add(sum[i][v], Vector::load(to, mask));
                Vector::store(to, sum[i][v], mask);
            } else {
                if (add) sum[i][v] = Vector::add(sum[i][v], Vector::load(to));
                Vector::store(to, sum[i][v]);
            }
        }
    }
}

using Tile = void (*)(Int depth, const float* a, Int a_row, Int a_column, const float* b, Int ldb,
                      bool add, float* c, Int ldc, Int tail);

template <int kRows, int kVectors, bool kMasked>
void tile_of(Int depth, const float* a, Int a_row, Int a_column, const float* b, Int ldb, bool add,
             float* c, Int ldc, Int tail) {
    product_tile<kRows, kVectors, kMasked>(depth, a, a_row, a_column, b, ldb, add, c, ldc, tail);
}

template <int kVectors, bool kMasked>
Tile tile_for(Int rows) {
    static constexpr Tile kTiles[] = {
        tile_of<1, kVectors, kMasked>,  tile_of<2, kVectors, kMasked>,
        tile_of<3, kVectors, kMasked>,  tile_of<4, kVectors, kMasked>,
        tile_of<5, kVectors, kMasked>,  tile_of<6, kVectors, kMasked>,
#if NACRE_PRODUCT_ROWS > 6
        tile_of<7, kVectors, kMasked>,  tile_of<8, kVectors, kMasked>,
        tile_of<9, kVectors, kMasked>,  tile_of<10, kVectors, kMasked>,
        tile_of<11, kVectors, kMasked>, tile_of<12, kVectors, kMasked>,
        tile_of<13, kVectors, kMasked>, tile_of<14, kVectors, kMasked>,
#endif
    };
    return kTiles[rows - 1];
}

constexpr Int kStrip = 2 * kWidth;  // columns of b that are taken at once
constexpr Int kDeepest = 256;

// One strip of b, at most kDeepest rows, and as much of a.
void product_strip(Int m, Int columns, Int depth, const float* a, Int a_row, Int a_column,
                   const float* b, Int ldb, bool add, float* c, Int ldc) {
    const Int tail = columns % kWidth ? columns % kWidth : kWidth;
    // Tiles of about equal height.
    const Int tiles = (m + NACRE_PRODUCT_ROWS - 1) / NACRE_PRODUCT_ROWS;
    for (Int t = 0; t < tiles; ++t) {
        const Int first = t * m / tiles, rows = (t + 1) * m / tiles - first;
        const Tile tile = columns == kStrip   ? tile_for<2, false>(rows)
                          : columns > kWidth  ? tile_for<2, true>(rows)
                          : columns == kWidth ? tile_for<1, false>(rows)
                                              : tile_for<1, true>(rows);
        tile(depth, a + first * a_row, a_row, a_column, b, ldb, add, c + first * ldc, ldc, tail);
    }
}

void product(Int m, Int n, Int depth, const float* a, Int a_row, Int a_column, const float* b,
             Int ldb, bool add, float* c, Int ldc) {
    alignas(64) float copy[kDeepest * kStrip];
    for (Int k = 0; k < depth; k += kDeepest) {
        const Int deep = least(kDeepest, depth - k);
        for (Int column = 0; column < n; column += kStrip) {
            const Int columns = least(kStrip, n - column);
            const float* strip = b + k * ldb + column;
            Int stride = ldb;
            // Several tiles read it: not from rows that compete for the same places of the cache.
            if (m > 3 * NACRE_PRODUCT_ROWS && columns == kStrip) {
                for (Int row = 0; row < deep; ++row) {
                    Vector::store(copy + row * kStrip, Vector::load(strip + row * ldb));
                    Vector::store(copy + row * kStrip + kWidth,
                                  Vector::load(strip + row * ldb + kWidth));
                }
                strip = copy;
                stride = kStrip;
            }
            product_strip(m, columns, deep, a + k * a_column, a_row, a_column, strip, stride,
                          add || k > 0, c + column, ldc);
        }
    }
}

// sum[i][j] += the inner products of kRows rows of x and kColumns rows of y.
template <int kRows, int kColumns>
inline void inner_tile(Int columns, const float* x, Int ldx, const float* y, Int ldy, double* sum,
                       Int lds) {
    Vector::Type partial[kRows][kColumns];
#pragma GCC unroll 8
    for (int i = 0; i < kRows; ++i) {
#pragma GCC unroll 8
        for (int j = 0; j < kColumns; ++j) partial[i][j] = Vector::zero();
    }
    const auto step = [&](auto load) {
        Vector::Type left[kRows];
#pragma GCC unroll 8
        for (int i = 0; i < kRows; ++i) left[i] = load(x + i * ldx);
#pragma GCC unroll 8
        for (int j = 0; j < kColumns; ++j) {
            const Vector::Type right = load(y + j * ldy);
#pragma GCC unroll 8
            for (int i = 0; i < kRows; ++i) {
                partial[i][j] = Vector::multiply_add(left[i], right, partial[i][j]);
            }
        }
    };
    Int k = 0;
    for (; k + kWidth <= columns; k += kWidth) {
        step([k](const float* row) { return Vector::load(row + k); });
    }
    if (k < columns) {
        const Vector::Mask mask = Vector::first(columns - k);
        step([k, mask](const float* row) { return Vector::load(row + k, mask); });
    }
#pragma GCC unroll 8
    for (int i = 0; i < kRows; ++i) {
        double* to = sum + i * lds;
        if constexpr (kColumns == 4) {
            const Vector::Type* p = partial[i];
            const __m256d four = _mm256_cvtps_pd(Vector::sums(p[0], p[1], p[2], p[3]));
            _mm256_storeu_pd(to, _mm256_add_pd(_mm256_loadu_pd(to), four));
        } else {
#pragma GCC unroll 8
            for (int j = 0; j < kColumns; ++j) {
                to[j] += static_cast<double>(Vector::sum(partial[i][j]));
            }
        }
    }
}

using InnerTile = void (*)(Int columns, const float* x, Int ldx, const float* y, Int ldy,
                           double* sum, Int lds);

template <int kRows, int kColumns>
void inner_tile_of(Int columns, const float* x, Int ldx, const float* y, Int ldy, double* sum,
                   Int lds) {
    inner_tile<kRows, kColumns>(columns, x, ldx, y, ldy, sum, lds);
}

template <int kRows>
InnerTile inner_tile_for(Int columns) {
    static constexpr InnerTile kTiles[] = {inner_tile_of<kRows, 1>, inner_tile_of<kRows, 2>,
                                           inner_tile_of<kRows, 3>, inner_tile_of<kRows, 4>};
    return kTiles[columns - 1];
}

InnerTile inner_tile_for(Int rows, Int columns) {
#if NACRE_INNER_ROWS > 3
    if (rows == 6) return inner_tile_for<6>(columns);
    if (rows == 5) return inner_tile_for<5>(columns);
    if (rows == 4) return inner_tile_for<4>(columns);
#endif
    if (rows == 3) return inner_tile_for<3>(columns);
    return rows == 2 ? inner_tile_for<2>(columns) : inner_tile_for<1>(columns);
}

constexpr Int kTileColumns = 4;
constexpr Int kPanel = 12;  // rows of y that stay in the first cache

// Parts of about equal depth, at most that deep, whole vectors: a short one would not be worth the
// sums at its end.
inline Int part_of(Int columns, Int deepest) {
    const Int parts = (columns + deepest - 1) / deepest;
    return (columns / kWidth / parts + 1) * kWidth;
}

void gram(Int rows, Int columns, const float* x, Int ldx, double* sum) {
    const Int step = part_of(columns, 768);
    for (Int k = 0; k < columns; k += step) {
        const Int depth = least(step, columns - k);
        const float* part = x + k;
        for (Int panel = 0; panel < rows; panel += kPanel) {
            const Int panel_end = least(panel + kPanel, rows);
            for (Int i = 0; i < panel_end; i += NACRE_INNER_ROWS) {
                const Int height = least(NACRE_INNER_ROWS, rows - i);
                for (Int j = panel; j < panel_end; j += kTileColumns) {
                    const Int width = least(kTileColumns, panel_end - j);
                    if (j + width <= i) continue;  // below the diagonal
                    inner_tile_for(height, width)(depth, part + i * ldx, ldx, part + j * ldx, ldx,
                                                  sum + i * rows + j, rows);
                }
            }
        }
    }
}

void inner(Int m, Int n, Int columns, const float* x, Int ldx, const float* y, Int ldy, double* sum,
           Int lds) {
    const Int step = part_of(columns, 512);
    for (Int k = 0; k < columns; k += step) {
        const Int depth = least(step, columns - k);
        for (Int panel = 0; panel < n; panel += kPanel) {
            const Int panel_end = least(panel + kPanel, n);
            for (Int i = 0; i < m; i += NACRE_INNER_ROWS) {
                const Int height = least(NACRE_INNER_ROWS, m - i);
                for (Int j = panel; j < panel_end; j += kTileColumns) {
                    const Int width = least(kTileColumns, panel_end - j);
                    inner_tile_for(height, width)(depth, x + i * ldx + k, ldx, y + j * ldy + k, ldy,
                                                  sum + i * lds + j, lds);
                }
            }
        }
    }
}

// kRows rows of c, (up to) kVectors vectors wide.
template <int kRows, int kVectors, bool kMasked>
inline void rows_tile(Int depth, Int first, const float* weights, const float* const* b, bool add,
                      float* const* c, Int tail) {
    const Vector::Mask mask = Vector::first(tail);
    Vector::Type sum[kRows][kVectors];
#pragma GCC unroll 4
    for (int i = 0; i < kRows; ++i) {
#pragma GCC unroll 4
        for (int v = 0; v < kVectors; ++v) {
            const float* from = c[i] + first + v * kWidth;
            const bool part = kMasked && v + 1 == kVectors;
            sum[i][v] = !add   ? Vector::zero()
                        : part ? Vector::load(from, mask)
                               : Vector::load(from);
        }
    }
    for (Int k = 0; k < depth; ++k) {
        const float* row = b[k] + first;
        // The next tile of this row: so many are read side by side that no processor foresees it.
#pragma GCC unroll 4
        for (int v = 0; v < kVectors * kWidth; v += 16) {
            __builtin_prefetch(row + kVectors * kWidth + v);
        }
        Vector::Type right[kVectors];
#pragma GCC unroll 4
        for (int v = 0; v < kVectors; ++v) {
            const float* from = row + v * kWidth;
            right[v] = kMasked && v + 1 == kVectors ? Vector::load(from, mask) : Vector::load(from);
        }
#pragma GCC unroll 4
        for (int i = 0; i < kRows; ++i) {
            const Vector::Type left = Vector::broadcast(weights[k * kRows + i]);
#pragma GCC unroll 4
            for (int v = 0; v < kVectors; ++v) {
                sum[i][v] = Vector::multiply_add(left, right[v], sum[i][v]);
            }
        }
    }
#pragma GCC unroll 4
    for (int i = 0; i < kRows; ++i) {
#pragma GCC unroll 4
        for (int v = 0; v < kVectors; ++v) {
            float* to = c[i] + first + v * kWidth;
            if (kMasked && v + 1 == kVectors) {
                Vector::store(to, sum[i][v], mask);
            } else {
                Vector::store(to, sum[i][v]);
            }
        }
    }
}

template <int kRows>
void rows_of(Int n, Int depth, const float* weights, const float* const* b, bool add,
             float* const* c) {
    constexpr Int kWide = NACRE_ROWS_VECTORS * kWidth;
    Int first = 0;
    for (; first + kWide <= n; first += kWide) {
        rows_tile<kRows, NACRE_ROWS_VECTORS, false>(depth, first, weights, b, add, c, kWidth);
    }
    for (; first < n; first += kWidth) {
        rows_tile<kRows, 1, true>(depth, first, weights, b, add, c, least(kWidth, n - first));
    }
}

void rows(Int m, Int n, Int depth, const float* weights, const float* const* b, bool add,
          float* const* c) {
    if (m == 4) return rows_of<4>(n, depth, weights, b, add, c);
    if (m == 3) return rows_of<3>(n, depth, weights, b, add, c);
    if (m == 2) return rows_of<2>(n, depth, weights, b, add, c);
    rows_of<1>(n, depth, weights, b, add, c);
}

}  // namespace
}  // namespace nacre
