#include "nacre/gram.hpp"

#include <algorithm>
#include <cmath>

#include "kernels.hpp"
#include "nacre/blas.hpp"

namespace nacre {

namespace {

constexpr Index kFloatColumns = 2048;
constexpr Index kMaxSlabs = 32;
constexpr Index kStrip = 32;

}  // namespace

GramSum::GramSum(Index rows) : rows_(rows), partial_(rows, rows) {
    sum_.setZero(rows, rows);
    partial_.setZero();
}

void GramSum::make_room(Index columns) {
    if (columns_ + columns > kFloatColumns) flush();
    columns_ += columns;
}

void GramSum::flush() {
    if (columns_ == 0) return;
    for (Index i = 0; i < rows_; ++i) {
        const float* from = partial_.data() + i * rows_;
        double* to = sum_.data() + i * rows_;
        for (Index j = i; j < rows_; ++j) to[j] += from[j];
    }
    columns_ = 0;
}

void GramSum::add_columns(const float* piece, Index columns, Index stride) {
    if (const Kernels* own = kernels()) {
        own->gram(rows_, columns, piece, stride, sum_.data());
        return;
    }
    for (Index first = 0; first < columns; first += kFloatColumns) {
        const Index count = std::min(kFloatColumns, columns - first);
        make_room(count);
        const float beta = columns_ == count ? 0.0f : 1.0f;
        syrk_upper(Op::kNone, rows_, count, piece + first, stride, beta, partial_.data(), rows_);
    }
}

void GramSum::add(const float* piece, const Unfolding& view) {
    if (view.inner > 1) {
        for (Index o = 0; o < view.outer; ++o) {
            add_columns(piece + o * rows_ * view.inner, view.inner, view.inner);
        }
        return;
    }
    for (Index first = 0; first < view.outer; first += kFloatColumns) {
        const Index count = std::min(kFloatColumns, view.outer - first);
        make_room(count);
        const bool add = columns_ > count;
        const float* part = piece + first * rows_;
        if (const Kernels* own = kernels()) {
            // Strips of columns, each down to the diagonal.
            for (Index j = 0; j < rows_; j += kStrip) {
                const Index width = std::min(kStrip, rows_ - j);
                own->product(j + width, width, count, part, 1, rows_, part + j, rows_, add,
                             partial_.data() + j, rows_);
            }
        } else {
            syrk_upper(Op::kTranspose, rows_, count, part, rows_, add ? 1.0f : 0.0f,
                       partial_.data(), rows_);
        }
    }
}

const MatrixD& GramSum::finish() {
    flush();
    return sum_;
}

void symmetrise(MatrixD& upper) {
    for (Index i = 0; i < upper.rows(); ++i) {
        for (Index j = 0; j < i; ++j) upper(i, j) = upper(j, i);
    }
}

void add_inner_products(Index m, Index n, Index columns, const float* x, Index ldx, const float* y,
                        Index ldy, double* sum, Index lds) {
    if (const Kernels* own = kernels()) {
        own->inner(m, n, columns, x, ldx, y, ldy, sum, lds);
        return;
    }
    MatrixF piece(m, n);
    for (Index first = 0; first < columns; first += kFloatColumns) {
        const Index count = std::min(kFloatColumns, columns - first);
        gemm(Op::kNone, Op::kTranspose, m, n, count, 1.0f, x + first, ldx, y + first, ldy, 0.0f,
             piece.data(), n);
        for (Index i = 0; i < m; ++i) {
            for (Index j = 0; j < n; ++j) sum[i * lds + j] += piece(i, j);
        }
    }
}

Index slab_count(Index tasks) { return std::clamp<Index>(tasks, 1, kMaxSlabs); }

MatrixD gram(Executor& executor, const Tensor& tensor, Index mode) {
    const Unfolding view = unfolding(tensor.shape(), mode);
    const auto [outer, rows, inner] = view;
    // Pieces: part of the columns of one slice, or several whole slices.
    constexpr Index kPieceColumns = 4096;
    const Index slices = std::max<Index>(1, kPieceColumns / inner);
    const Index parts = (inner + kPieceColumns - 1) / kPieceColumns;
    const Index pieces = ((outer + slices - 1) / slices) * parts;
    const Index slabs = slab_count(pieces);
    std::vector<MatrixD> partial(at(slabs));
    executor.parallel_for(slabs, [&](Index slab, int) {
        GramSum sum(rows);
        for (Index piece = slab * pieces / slabs; piece < (slab + 1) * pieces / slabs; ++piece) {
            const Index slice = piece / parts * slices, column = piece % parts * kPieceColumns;
            const float* data = tensor.data() + slice * rows * inner + column;
            if (parts > 1) {
                sum.add_columns(data, std::min(kPieceColumns, inner - column), inner);
            } else {
                sum.add(data, {std::min(slices, outer - slice), rows, inner});
            }
        }
        partial[at(slab)] = sum.finish();
    });
    MatrixD total = partial[0];
    for (Index slab = 1; slab < slabs; ++slab) total += partial[at(slab)];
    symmetrise(total);
    return total;
}

MatrixF leading_basis(MatrixD gram, Index rank) {
    const Index n = gram.rows();
    MatrixD vectors;
    leading_eigen(gram, rank, vectors);
    MatrixF basis(n, rank);
    for (Index r = 0; r < rank; ++r) {
        const auto vector = vectors.row(r);
        Index largest = 0;
        // The first entry within rounding of the largest: two equal ones must not make the sign
        // depend on the last bit.
        const double peak = vector.cwiseAbs().maxCoeff();
        while (std::abs(vector(largest)) < peak * (1 - 1e-9)) ++largest;
        const double sign = vector(largest) < 0 ? -1 : 1;
        for (Index i = 0; i < n; ++i) basis(i, r) = static_cast<float>(sign * vector(i));
    }
    return basis;
}

}  // namespace nacre
