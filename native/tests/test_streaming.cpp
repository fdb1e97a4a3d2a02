#include "check.hpp"
#include "nacre/gram.hpp"
#include "nacre/streaming.hpp"

using namespace nacre;

namespace {

// The tensor of a BTF by its definition: light row channels * light + channel.
dense::Array as_array(const std::vector<float>& samples, const Shape& s) {
    dense::Array result({s[0] * s[4], s[1], s[2], s[3]});
    dense::for_each(s, [&](const Shape& i) {
        const Index from = (((i[0] * s[1] + i[1]) * s[2] + i[2]) * s[3] + i[3]) * s[4] + i[4];
        result[{i[0] * s[4] + i[4], i[1], i[2], i[3]}] = samples[static_cast<std::size_t>(from)];
    });
    return result;
}

dense::Array in_front(const dense::Array& a, std::size_t first) {
    dense::Array result(front_shape(a.shape, static_cast<Index>(first)));
    dense::for_each(
        a.shape, [&](const Shape& i) { result[front_shape(i, static_cast<Index>(first))] = a[i]; });
    return result;
}

}  // namespace

int main() {
    Executor executor(2);
    for (const Shape& s : {Shape{5, 4, 6, 7, 3}, Shape{3, 2, 70, 90, 3}, Shape{4, 1, 1, 5, 1}}) {
        Random random(11);
        std::vector<float> samples(static_cast<std::size_t>(product(s)));
        for (float& v : samples) v = static_cast<float>(random.uniform());
        const BtfSource source(samples.data(), SampleType::kFloat, {s[0], s[1], s[2], s[3], s[4]});
        const dense::Array array = as_array(samples, s);
        CHECK(source.shape() == array.shape);
        const double tolerance = 1e-5 * std::sqrt(array.squared_norm());

        for (std::size_t first = 0; first < 4; ++first) {
            const Index front = static_cast<Index>(first);
            const Tensor loaded = load(executor, source, front);
            CHECK(dense::distance(dense::Array(loaded), in_front(array, first)) == 0);
            const Tensor moved = move_to_front(executor, load(executor, source), front);
            CHECK(dense::distance(dense::Array(moved), in_front(array, first)) == 0);
            for (std::size_t mode = 0; mode < 4; ++mode) {
                const MatrixF basis = random_basis(array.shape[mode], 1 + array.shape[mode] / 2, 4);
                const Tensor projected =
                    project(executor, source, static_cast<Index>(mode), basis, front);
                const dense::Array expected = in_front(
                    dense::mode_product(array, mode, basis.cast<double>().transpose()), first);
                CHECK(projected.shape() == expected.shape);
                CHECK(dense::distance(dense::Array(projected), expected) < tolerance);
            }
        }
        std::vector<MatrixF> bases;
        for (Index extent : array.shape) bases.push_back(random_basis(extent, (extent + 1) / 2, 6));
        for (std::size_t lead = 0; lead < 4; ++lead) {
            for (std::size_t skip = 0; skip < 4; ++skip) {  // another mode without a basis
                std::vector<const MatrixF*> used;
                dense::Array expected = array;
                for (std::size_t n = 0; n < 4; ++n) {
                    used.push_back(n == lead || n == skip ? nullptr : &bases[n]);
                    if (used[n]) {
                        expected =
                            dense::mode_product(expected, n, bases[n].cast<double>().transpose());
                    }
                }
                const Tensor result = project(executor, source, used);
                CHECK(result.shape() == expected.shape);
                CHECK(dense::distance(dense::Array(result), expected) < tolerance);
            }
        }
    }

    // Blocks that are read part by part, against the same products of the whole.
    const Shape s{2, 40, 90, 128, 3};
    Random random(7);
    std::vector<float> samples(static_cast<std::size_t>(product(s)));
    for (float& v : samples) v = static_cast<float>(random.uniform());
    const BtfSource source(samples.data(), SampleType::kFloat, {s[0], s[1], s[2], s[3], s[4]});
    const Tensor whole = load(executor, source);
    std::vector<MatrixF> bases;
    for (Index extent : whole.shape())
        bases.push_back(random_basis(extent, extent - 5 / extent, 6));
    bases[1] = random_basis(40, 6, 1);
    for (const Bases& used : {Bases{nullptr, &bases[1], &bases[2], &bases[3]},
                              Bases{nullptr, &bases[1], nullptr, &bases[3]},
                              Bases{&bases[0], &bases[1], &bases[2], nullptr},
                              Bases{&bases[0], &bases[1], &bases[2], &bases[3]}}) {
        Tensor expected, scratch;
        multi_mode_product(executor, whole, used, Op::kTranspose, expected, scratch);
        const double passes = source.passes();
        const Tensor result = project(executor, source, used);
        CHECK(source.passes() == passes + 1);
        CHECK(result.shape() == expected.shape());
        const double norm = std::sqrt(squared_norm(executor, expected));
        CHECK(dense::distance(dense::Array(result), dense::Array(expected)) < 1e-5 * norm);
        const std::vector<Index> order{2, 0, 3, 1};
        const Tensor permuted = project(executor, source, used, order);
        CHECK(permuted.dim(1) == result.dim(0));
        const dense::Array natural(result), moved(permuted);
        for (const Shape& i : {Shape{1, 2, 3, 4}, Shape{5, 5, 60, 77}}) {
            CHECK((moved[{i[2], i[0], i[3], i[1]}] == natural[i]));
        }
        for (std::size_t mode = 0; mode < 4; ++mode) {
            if (used[mode]) continue;
            const Index n = static_cast<Index>(mode);
            const MatrixD direct = gram(executor, source, n, used);
            const MatrixD through = gram(executor, expected, n);
            CHECK((direct - through).norm() < 1e-5 * through.norm());
        }
    }
    std::puts("ok");
}
