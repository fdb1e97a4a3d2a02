#include <algorithm>
#include <set>

#include "check.hpp"
#include "nacre/kmeans.hpp"

using namespace nacre;

int main() {
    // Three groups far apart are found, whatever the seed; the same seed gives the same clusters.
    MatrixD points(30, 2);
    Random random(3);
    for (Index i = 0; i < 30; ++i) {
        points(i, 0) = 10.0 * (i % 3) + random.uniform();
        points(i, 1) = 5.0 * (i % 3) + random.uniform();
    }
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
        const std::vector<Index> clusters = kmeans(points, 3, seed);
        for (std::size_t i = 3; i < 30; ++i) CHECK(clusters[i] == clusters[i % 3]);
        CHECK(std::set<Index>(clusters.begin(), clusters.end()).size() == 3);
        CHECK(kmeans(points, 3, seed) == clusters);
    }
    // No cluster is empty, not even where all points are the same, or each is its own.
    const MatrixD same = MatrixD::Constant(6, 3, 0.5);
    for (Index count : {1, 4, 6}) {
        const std::vector<Index> clusters = kmeans(same, count, 1);
        CHECK(std::set<Index>(clusters.begin(), clusters.end()).size() ==
              static_cast<std::size_t>(count));
    }
    const std::vector<Index> own = kmeans(points, 30, 2);
    CHECK(std::set<Index>(own.begin(), own.end()).size() == 30);
    std::puts("ok");
}
