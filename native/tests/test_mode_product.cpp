#include "check.hpp"
#include "nacre/mode_product.hpp"

using namespace nacre;

int main() {
    Executor executor(2);
    // Small ones, and ones large enough to be cut into tasks in each of the three ways.
    const std::vector<Shape> shapes = {{3, 4, 5, 2}, {1, 7, 1, 3}, {6}, {40, 30, 1}, {5, 40, 300}};
    for (const Shape& shape : shapes) {
        const Tensor tensor = random_tensor(shape, 3);
        const dense::Array array(tensor);
        for (std::size_t n = 0; n < shape.size(); ++n) {
            for (Index rank : {Index{1}, shape[n]}) {
                const MatrixF basis = random_matrix(shape[n], rank, 5);
                Tensor projected;
                mode_product(executor, tensor, static_cast<Index>(n), basis, Op::kTranspose,
                             projected);
                const dense::Array expected =
                    dense::mode_product(array, n, basis.cast<double>().transpose());
                CHECK(projected.shape() == expected.shape);
                CHECK(dense::distance(dense::Array(projected), expected) <
                      1e-6 * std::sqrt(expected.squared_norm()));
                Tensor expanded;
                mode_product(executor, projected, static_cast<Index>(n), basis, Op::kNone,
                             expanded);
                const dense::Array back = dense::mode_product(expected, n, basis.cast<double>());
                CHECK(dense::distance(dense::Array(expanded), back) <
                      2e-6 * std::sqrt(back.squared_norm()));
            }
        }
        CHECK_NEAR(squared_norm(executor, tensor), array.squared_norm(), 1e-9 * tensor.size());
    }
    // Cut into tasks: the same as one thread doing it whole.
    const std::vector<std::pair<Shape, Index>> large = {
        {{9000, 64}, 1}, {{300, 64, 64}, 1}, {{80, 40000}, 0}};
    for (const auto& [shape, mode] : large) {
        const Tensor tensor = random_tensor(shape, 8);
        const MatrixF basis = random_matrix(shape[static_cast<std::size_t>(mode)], 20, 9);
        Tensor tasks;
        mode_product(executor, tensor, mode, basis, Op::kTranspose, tasks);
        Tensor whole(tasks.shape());
        mode_product(tensor.data(), unfolding(shape, mode), basis, Op::kTranspose, whole.data());
        CHECK(dense::distance(dense::Array(tasks), dense::Array(whole)) < 1e-2);
    }
    // Several modes at once.
    const Tensor tensor = random_tensor({4, 5, 6}, 4);
    const MatrixF u0 = random_matrix(4, 2, 6), u2 = random_matrix(6, 3, 7);
    Tensor out, scratch;
    multi_mode_product(executor, tensor, {&u0, nullptr, &u2}, Op::kTranspose, out, scratch);
    const dense::Array expected = dense::mode_product(
        dense::mode_product(dense::Array(tensor), 0, u0.cast<double>().transpose()), 2,
        u2.cast<double>().transpose());
    CHECK(out.shape() == Shape({2, 5, 3}));
    CHECK(dense::distance(dense::Array(out), expected) < 1e-5);
    multi_mode_product(executor, tensor, {nullptr, nullptr, nullptr}, Op::kNone, out, scratch);
    CHECK(dense::distance(dense::Array(out), dense::Array(tensor)) == 0);
    std::puts("ok");
}
