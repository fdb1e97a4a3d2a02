// Single texels against the sum over clusters written out with dense, mostly zero bases.
#include <numeric>

#include "../src/texel_kernel.hpp"
#include "check.hpp"
#include "nacre/evaluator.hpp"

using namespace nacre;

namespace {

// A model that owns its arrays.
struct Owned {
    std::vector<float> core;
    std::array<std::vector<float>, 4> bases;
    std::array<std::vector<std::uint32_t>, 4> members;
    Evaluator::Model model;
};

struct Setting {
    Shape rows, ranks, clusters, mixtures;
    std::array<bool, 4> shared;  // one basis for all clusters
    Index channels;
};

std::vector<float> numbers(Index count, Random& random) {
    std::vector<float> values(at(count));
    for (float& value : values) value = static_cast<float>(random.uniform() - 0.5);
    return values;
}

Owned random_model(const Setting& setting, std::uint64_t seed) {
    Random random(seed);
    Owned owned;
    owned.core = numbers(product(setting.clusters) * product(setting.ranks), random);
    owned.model.core = owned.core.data();
    owned.model.channels = setting.channels;
    for (std::size_t n = 0; n < 4; ++n) {
        Evaluator::Mode& mode = owned.model.modes[n];
        mode.clusters = setting.clusters[n];
        mode.mixtures = setting.mixtures[n];
        mode.rows = setting.rows[n];
        mode.rank = setting.ranks[n];
        mode.owners = setting.shared[n] ? 1 : product(setting.clusters) / mode.clusters;
        owned.bases[n] = numbers(mode.owners * mode.rows * mode.mixtures * mode.rank, random);
        mode.basis = owned.bases[n].data();
        if (mode.clusters == 1) continue;
        const Index items = mode.rows / (n == 0 ? setting.channels : 1);
        for (Index i = 0; i < items; ++i) {
            for (Index k = 0; k < mode.mixtures; ++k) {
                owned.members[n].push_back(static_cast<std::uint32_t>((i + k) % mode.clusters));
            }
        }
        mode.members = owned.members[n].data();
    }
    return owned;
}

// U of one mode in a cluster vector: rows x rank, zero where a row is not a member.
MatrixD dense_basis(const Evaluator::Model& model, std::size_t n, const Shape& vector) {
    const Evaluator::Mode& mode = model.modes[n];
    Index owner = 0;
    for (std::size_t m = 0; m < 4; ++m) {
        if (m != n && mode.owners > 1) owner = owner * model.modes[m].clusters + vector[m];
    }
    MatrixD basis = MatrixD::Zero(mode.rows, mode.rank);
    for (Index i = 0; i < mode.rows; ++i) {
        const Index item = n == 0 ? i / model.channels : i;
        for (Index k = 0; k < mode.mixtures; ++k) {
            if (mode.members && mode.members[item * mode.mixtures + k] != vector[n]) continue;
            for (Index r = 0; r < mode.rank; ++r) {
                basis(i, r) =
                    mode.basis[((owner * mode.rows + i) * mode.mixtures + k) * mode.rank + r];
            }
        }
    }
    return basis;
}

dense::Array dense_model(const Setting& setting, const Evaluator::Model& model) {
    dense::Array total(setting.rows);
    Index number = 0;
    dense::for_each(setting.clusters, [&](const Shape& vector) {
        dense::Array part(setting.ranks);
        const Index size = product(setting.ranks);
        std::copy_n(model.core + number++ * size, size, part.values.begin());
        for (std::size_t n = 0; n < 4; ++n) {
            part = dense::mode_product(part, n, dense_basis(model, n, vector));
        }
        for (std::size_t i = 0; i < part.values.size(); ++i) total.values[i] += part.values[i];
    });
    return total;
}

void compare(const Setting& setting, std::uint64_t seed) {
    const Owned owned = random_model(setting, seed);
    const dense::Array expected = dense_model(setting, owned.model);
    Executor executor(2);
    const Evaluator evaluator(executor, owned.model);
    const Index channels = setting.channels, height = setting.rows[2], width = setting.rows[3];
    CHECK(evaluator.lights() == setting.rows[0] / channels && evaluator.views() == setting.rows[1]);
    CHECK(evaluator.height() == height && evaluator.width() == width);
    CHECK(evaluator.reads() == product(setting.mixtures) * setting.ranks[0] * setting.ranks[1]);

    // Every light and view, all texels of each in one list.
    std::vector<Index> lights, views, texels(at(height * width));
    std::iota(texels.begin(), texels.end(), 0);
    for (Index l = 0; l < evaluator.lights(); ++l) {
        for (Index v = 0; v < evaluator.views(); ++v) {
            lights.push_back(l);
            views.push_back(v);
        }
    }
    std::vector<float> values(lights.size() * texels.size() * at(channels));
    evaluator.decode(executor, lights, views, texels, true, values.data());
    const float* value = values.data();
    for (std::size_t p = 0; p < lights.size(); ++p) {
        for (Index texel : texels) {
            for (Index c = 0; c < channels; ++c) {
                const double dense =
                    expected[{lights[p] * channels + c, views[p], texel / width, texel % width}];
                CHECK_NEAR(*value++, dense, 1e-4);
            }
        }
    }

    // The same as lists of their own, one of which is in another order.
    std::vector<Index> own;
    for (std::size_t p = 0; p < lights.size(); ++p) {
        own.insert(own.end(), texels.begin(), texels.end());
    }
    std::reverse(own.begin(), own.begin() + static_cast<std::ptrdiff_t>(texels.size()));
    std::vector<float> again(values.size());
    evaluator.decode(executor, lights, views, own, false, again.data());
    const std::size_t first = texels.size() * at(channels);
    for (std::size_t i = first; i < again.size(); ++i) CHECK(again[i] == values[i]);
    for (std::size_t i = 0; i < first; ++i) {
        const std::size_t texel = texels.size() - 1 - i / at(channels);
        CHECK_NEAR(again[i], values[texel * at(channels) + i % at(channels)], 1e-6);
    }
    evaluator.decode(executor, {}, {}, own, false, again.data());
    evaluator.decode(executor, lights, views, {}, true, again.data());
}

// The kernel for any processor against the one for this.
void compare_kernels() {
    Random random(9);
    const Index count = 11, record = 72;
    const std::vector<float> texture = numbers(count * record, random);
    const std::vector<Index> texels{3, 10, 0, 3, 7, 1, 9, 2, 8, 6, 5}, blocks{48, 0, 16};
    for (Index channels = 1; channels <= kGroup; ++channels) {
        const std::vector<float> weights = numbers(3 * 16 * channels, random);
        std::vector<float> seen(at(count * channels)), expected(seen.size());
        TexelSums sums{texture.data(), record,      texels.data(), count, blocks.data(), 3, 16,
                       weights.data(), seen.data(), channels};
        texel_kernel(static_cast<int>(channels))(sums);
        sums.out = expected.data();
        texel_kernel(static_cast<int>(channels), true)(sums);
        for (std::size_t i = 0; i < seen.size(); ++i) CHECK_NEAR(seen[i], expected[i], 1e-5);
        double sum = 0;
        for (Index i = 0; i < 48; ++i) {
            const Index place = texels[5] * record + blocks[at(i / 16)] + i % 16;
            sum += texture[at(place)] * weights[at(i / 8 * 8 * channels + i % 8)];
        }
        CHECK_NEAR(seen[at(5 * channels)], sum, 1e-5);
    }
}

void wrong_models() {
    const Setting setting{{6, 5, 4, 3}, {2, 2, 2, 2}, {2, 3, 1, 1}, {1, 2, 1, 1}, {}, 3};
    const Owned owned = random_model(setting, 1);
    Evaluator::Model model = owned.model;
    CHECK(message_of([&] { Evaluator::check(model); }).empty());
    model.channels = 4;
    CHECK(message_of([&] { Evaluator::check(model); }) ==
          "channels: expected a divisor of the 6 light rows, got 4");
    model = owned.model;
    model.modes[1].members = nullptr;
    CHECK(message_of([&] { Evaluator::check(model); }) ==
          "members: expected those of the clustered mode view");
    model = owned.model;
    model.modes[2].owners = 2;
    CHECK(message_of([&] { Evaluator::check(model); }) ==
          "basis: expected 1 or 6 owners of the y basis, got 2");
    std::vector<std::uint32_t> sets(10, 1);
    model = owned.model;
    model.modes[1].members = sets.data();
    CHECK(message_of([&] { Evaluator::check(model); }) ==
          "members: expected distinct clusters, got 1 twice for view 0");
    sets.assign(10, 3);
    CHECK(message_of([&] { Evaluator::check(model); }) ==
          "members: expected clusters below 3, got 3 for view 0");
}

}  // namespace

int main() {
    // N-SVD, K-CTA of the view with local y and x, MK-CTA, and every mode clustered.
    compare({{9, 4, 5, 20}, {5, 3, 4, 3}, {1, 1, 1, 1}, {1, 1, 1, 1}, {true, true, true, true}, 3},
            1);
    compare({{6, 5, 18, 4}, {3, 3, 2, 3}, {1, 4, 1, 1}, {1, 3, 1, 1}, {true, false}, 3}, 2);
    compare({{8, 6, 4, 5}, {4, 4, 3, 2}, {3, 4, 1, 1}, {2, 3, 1, 1}, {false, false, true, true}, 2},
            3);
    compare({{5, 4, 4, 5}, {2, 3, 2, 2}, {2, 2, 3, 2}, {1, 2, 2, 2}, {}, 5}, 4);
    compare({{1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}, {}, 1}, 5);
    compare_kernels();
    wrong_models();
    std::puts("ok");
}
