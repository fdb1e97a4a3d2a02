#include "largest.hpp"

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

constexpr Index kStrip = 64;    // values that are looked at together
constexpr Index kSpare = 4096;  // candidates beyond twice the count between two prunings

bool before(const Coefficient& a, const Coefficient& b) {
    const float x = std::abs(a.value), y = std::abs(b.value);
    return x > y || (x == y && a.position < b.position);
}

// Keeps the first `count`; the magnitude of the last of them.
float prune(std::vector<Coefficient>& found, Index count) {
    const auto last = found.begin() + static_cast<std::ptrdiff_t>(count - 1);
    std::nth_element(found.begin(), last, found.end(), before);
    const float least = std::abs(last->value);
    found.resize(at(count));
    return least;
}

}  // namespace

void largest(const float* values, Index size, Index count, std::vector<Coefficient>& found) {
    found.clear();
    if (count <= 0) return;
    // Candidates are those above a bound, which rises to the smallest of the best `count` so far
    // whenever there are too many: nearly all values are passed over, many at a time.
    float bound = 0;
    const std::size_t most = at(2 * count + kSpare);
    found.reserve(most + at(kStrip));
    for (Index first = 0; first < size; first += kStrip) {
        const Index end = std::min(first + kStrip, size);
        bool any = false;
        for (Index i = first; i < end; ++i) any |= std::abs(values[i]) > bound;
        if (!any) continue;
        for (Index i = first; i < end; ++i) {
            if (std::abs(values[i]) > bound) {
                found.push_back({static_cast<std::uint32_t>(i), values[i]});
            }
        }
        if (found.size() >= most) bound = prune(found, count);
    }
    if (static_cast<Index>(found.size()) > count) prune(found, count);
}

void sort_by_importance(std::vector<Coefficient>& coefficients) {
    std::sort(coefficients.begin(), coefficients.end(), before);
}

double energy(const std::vector<Coefficient>& coefficients) {
    double sum = 0;
    for (const Coefficient& c : coefficients) sum += static_cast<double>(c.value) * c.value;
    return sum;
}

}  // namespace nacre
