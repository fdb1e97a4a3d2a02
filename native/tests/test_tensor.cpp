#include "check.hpp"
#include "nacre/tensor.hpp"

using namespace nacre;

int main() {
    const Shape shape{3, 4, 5, 2};
    const Unfolding view = unfolding(shape, 1);
    CHECK(view.outer == 3 && view.rows == 4 && view.inner == 10);
    CHECK(unfolding(shape, 0).outer == 1 && unfolding(shape, 3).inner == 1);

    // Blocks out and in again, ragged and whole.
    const Tensor tensor = random_tensor(shape, 1);
    const dense::Array array(tensor);
    const std::vector<std::pair<Shape, Shape>> blocks = {{{0, 0, 0, 0}, {3, 4, 5, 2}},
                                                         {{1, 2, 1, 0}, {2, 1, 3, 2}},
                                                         {{0, 1, 4, 1}, {3, 3, 1, 1}},
                                                         {{2, 0, 0, 0}, {1, 4, 5, 2}}};
    for (const auto& [begin, size] : blocks) {
        Tensor block(size);
        copy_out(tensor.data(), shape, begin, size, block.data());
        const dense::Array copy(block);
        dense::for_each(size, [&](const Shape& index) {
            Shape full = index;
            for (std::size_t n = 0; n < full.size(); ++n) full[n] += begin[n];
            CHECK(copy[index] == array[full]);
        });
        Tensor back(shape);
        back.fill(-9);
        copy_in(block.data(), begin, size, shape, back.data());
        Index inside = 0;
        for (Index i = 0; i < back.size(); ++i) {
            if (back.data()[i] == -9) continue;
            CHECK(back.data()[i] == tensor.data()[i]);
            ++inside;
        }
        CHECK(inside == product(size));
    }
    Tensor copy = tensor;
    const Tensor empty, same = empty;
    CHECK(same.size() == 0 && same.order() == 0);
    CHECK(copy.data() != tensor.data() && copy.data()[7] == tensor.data()[7]);
    std::puts("ok");
}
