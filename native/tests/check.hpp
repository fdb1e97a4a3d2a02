// Checks, and the dense, obvious versions of what the library does: double, one element at a time.
#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "nacre/random.hpp"
#include "nacre/tensor.hpp"

#define CHECK(condition)                                                        \
    do {                                                                        \
        if (!(condition)) {                                                     \
            std::printf("%s:%d: failed: %s\n", __FILE__, __LINE__, #condition); \
            std::exit(1);                                                       \
        }                                                                       \
    } while (0)

#define CHECK_NEAR(a, b, tolerance)                                                               \
    do {                                                                                          \
        const double check_a = (a), check_b = (b);                                                \
        if (!(std::abs(check_a - check_b) <= (tolerance))) {                                      \
            std::printf("%s:%d: failed: %s = %.9g, %s = %.9g\n", __FILE__, __LINE__, #a, check_a, \
                        #b, check_b);                                                             \
            std::exit(1);                                                                         \
        }                                                                                         \
    } while (0)

// The message of the exception that `call` throws, or "" if it throws none.
inline std::string message_of(const std::function<void()>& call) {
    try {
        call();
    } catch (const std::exception& error) {
        return error.what();
    }
    return "";
}

namespace nacre::dense {

// A tensor of doubles with element access by index vector.
struct Array {
    Shape shape;
    std::vector<double> values;

    explicit Array(Shape s)
        : shape(std::move(s)), values(static_cast<std::size_t>(product(shape))) {}
    explicit Array(const Tensor& t) : shape(t.shape()), values(t.data(), t.data() + t.size()) {}

    double& operator[](const Shape& index) { return values[offset(index)]; }
    double operator[](const Shape& index) const { return values[offset(index)]; }

    std::size_t offset(const Shape& index) const {
        Index result = 0;
        for (std::size_t n = 0; n < shape.size(); ++n) result = result * shape[n] + index[n];
        return static_cast<std::size_t>(result);
    }

    double squared_norm() const {
        double sum = 0;
        for (double v : values) sum += v * v;
        return sum;
    }
};

inline void for_each(const Shape& shape, const std::function<void(const Shape&)>& body) {
    Shape index(shape.size(), 0);
    for (Index i = 0; i < product(shape); ++i) {
        body(index);
        for (std::size_t n = shape.size(); n-- > 0;) {
            if (++index[n] < shape[n]) break;
            index[n] = 0;
        }
    }
}

// Eq. 2: A x_n U, with U of J x I.
inline Array mode_product(const Array& a, std::size_t mode, const MatrixD& u) {
    Shape shape = a.shape;
    shape[mode] = u.rows();
    Array result(shape);
    for_each(shape, [&](const Shape& index) {
        Shape from = index;
        double sum = 0;
        for (Index i = 0; i < u.cols(); ++i) {
            from[mode] = i;
            sum += a[from] * u(index[mode], i);
        }
        result[index] = sum;
    });
    return result;
}

// ufn(A): the mode-n subtensors as rows (the order of the columns does not matter here).
inline MatrixD unfold(const Array& a, std::size_t mode) {
    Shape rest = a.shape;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(mode));
    MatrixD result(a.shape[mode], product(rest));
    Index column = 0;
    for_each(rest, [&](const Shape& index) {
        Shape full = index;
        full.insert(full.begin() + static_cast<std::ptrdiff_t>(mode), 0);
        for (Index i = 0; i < a.shape[mode]; ++i) {
            full[mode] = i;
            result(i, column) = a[full];
        }
        ++column;
    });
    return result;
}

inline double distance(const Array& a, const Array& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.values.size(); ++i) {
        sum += (a.values[i] - b.values[i]) * (a.values[i] - b.values[i]);
    }
    return std::sqrt(sum);
}

}  // namespace nacre::dense

namespace nacre {

inline Tensor random_tensor(Shape shape, std::uint64_t seed) {
    Random random(seed);
    Tensor tensor(std::move(shape));
    for (Index i = 0; i < tensor.size(); ++i) {
        tensor.data()[i] = static_cast<float>(random.uniform() - 0.3);
    }
    return tensor;
}

inline MatrixF random_matrix(Index rows, Index columns, std::uint64_t seed) {
    Random random(seed);
    MatrixF matrix(rows, columns);
    for (Index i = 0; i < matrix.size(); ++i) {
        matrix.data()[i] = static_cast<float>(random.uniform() - 0.5);
    }
    return matrix;
}

// Orthonormal columns, by Gram and Schmidt.
inline MatrixF random_basis(Index rows, Index columns, std::uint64_t seed) {
    MatrixD matrix = random_matrix(rows, columns, seed).cast<double>();
    for (Index c = 0; c < columns; ++c) {
        for (int twice = 0; twice < 2; ++twice) {
            for (Index d = 0; d < c; ++d) {
                matrix.col(c) -= matrix.col(d).dot(matrix.col(c)) * matrix.col(d);
            }
        }
        matrix.col(c).normalize();
    }
    return matrix.cast<float>();
}

inline double orthonormality_error(const MatrixF& basis) {
    const MatrixD u = basis.cast<double>();
    return (u.transpose() * u - MatrixD::Identity(u.cols(), u.cols())).cwiseAbs().maxCoeff();
}

}  // namespace nacre
