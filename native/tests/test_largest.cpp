#include <algorithm>

#include "check.hpp"
#include "largest.hpp"

using namespace nacre;

namespace {

// Sorts everything.
std::vector<Coefficient> by_sorting(const std::vector<float>& values, Index count) {
    std::vector<Coefficient> all;
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (values[i] != 0) all.push_back({static_cast<std::uint32_t>(i), values[i]});
    }
    sort_by_importance(all);
    all.resize(std::min(all.size(), at(count)));
    return all;
}

void check(const std::vector<float>& values, Index count) {
    std::vector<Coefficient> found;
    largest(values.data(), static_cast<Index>(values.size()), count, found);
    sort_by_importance(found);
    const std::vector<Coefficient> expected = by_sorting(values, count);
    CHECK(found.size() == expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
        CHECK(found[i].position == expected[i].position && found[i].value == expected[i].value);
    }
}

}  // namespace

int main() {
    Random random(1);
    std::vector<float> noise(20000), ties(20000), rising(20000), sparse(20000);
    for (std::size_t i = 0; i < noise.size(); ++i) {
        noise[i] = static_cast<float>(random.uniform() - 0.5);
        ties[i] = static_cast<float>(random.next() % 5) - 2;
        rising[i] = static_cast<float>(i) * (i % 2 ? -1.0f : 1.0f);
        sparse[i] = random.next() % 500 ? 0.0f : noise[i];
    }
    for (const auto& values : {noise, ties, rising, sparse}) {
        for (Index count : {0, 1, 3, 100, 5000, 20000, 30000}) check(values, count);
    }
    check({}, 3);
    check({0.0f, -0.0f}, 3);
    check({1.0f, -1.0f, 2.0f}, 2);
    CHECK_NEAR(energy({{0, 3.0f}, {1, -4.0f}}), 25, 0);

    // Sorted: larger first, the lower position among equal magnitudes.
    std::vector<Coefficient> some = {{4, 1}, {2, -1}, {3, 2}};
    sort_by_importance(some);
    CHECK(some[0].position == 3 && some[1].position == 2 && some[2].position == 4);
    std::puts("ok");
}
