#include "nacre/kmeans.hpp"

#include <algorithm>
#include <limits>

#include "nacre/random.hpp"

namespace nacre {

namespace {

constexpr int kRestarts = 32;
constexpr int kMaxIterations = 100;

struct Clustering {
    std::vector<Index> cluster;
    MatrixD centres;
    double cost = std::numeric_limits<double>::infinity();
};

// K-means++: each further centre is a point drawn with probability proportional to its squared
// distance from the nearest centre so far.
MatrixD seed_centres(const MatrixD& points, Index clusters, Random& random) {
    const Index n = points.rows();
    MatrixD centres(clusters, points.cols());
    std::vector<double> distance(at(n), std::numeric_limits<double>::infinity());
    Index chosen = std::min<Index>(n - 1, static_cast<Index>(random.uniform() * n));
    for (Index c = 0; c < clusters; ++c) {
        centres.row(c) = points.row(chosen);
        double total = 0;
        for (Index i = 0; i < n; ++i) {
            double& d = distance[at(i)];
            d = std::min(d, (points.row(i) - centres.row(c)).squaredNorm());
            total += d;
        }
        double target = random.uniform() * total;
        for (Index i = 0; i < n; ++i) {
            if (distance[at(i)] <= 0) continue;
            chosen = i;
            target -= distance[at(i)];
            if (target < 0) break;
        }
    }
    return centres;
}

void assign(const MatrixD& points, Clustering& result) {
    result.cost = 0;
    for (Index i = 0; i < points.rows(); ++i) {
        double nearest = std::numeric_limits<double>::infinity();
        for (Index c = 0; c < result.centres.rows(); ++c) {
            const double d = (points.row(i) - result.centres.row(c)).squaredNorm();
            if (d < nearest) {
                nearest = d;
                result.cluster[at(i)] = c;
            }
        }
        result.cost += nearest;
    }
}

// Gives every empty cluster the point farthest from its own centre, out of a cluster with others.
void fill_empty(const MatrixD& points, Clustering& result) {
    std::vector<Index> count(at(result.centres.rows()), 0);
    for (Index c : result.cluster) ++count[at(c)];
    for (Index c = 0; c < result.centres.rows(); ++c) {
        if (count[at(c)] > 0) continue;
        Index farthest = -1;
        double distance = -1;
        for (Index i = 0; i < points.rows(); ++i) {
            const Index own = result.cluster[at(i)];
            if (count[at(own)] < 2) continue;
            const double d = (points.row(i) - result.centres.row(own)).squaredNorm();
            if (d > distance) {
                distance = d;
                farthest = i;
            }
        }
        --count[at(result.cluster[at(farthest)])];
        result.cluster[at(farthest)] = c;
        count[at(c)] = 1;
        result.centres.row(c) = points.row(farthest);
    }
}

}  // namespace

std::vector<Index> kmeans(const MatrixD& points, Index clusters, std::uint64_t seed) {
    Random random(seed);
    Clustering best;
    for (int restart = 0; restart < kRestarts; ++restart) {
        Clustering current;
        current.centres = seed_centres(points, clusters, random);
        current.cluster.assign(at(points.rows()), 0);
        for (int i = 0; i < kMaxIterations; ++i) {
            const std::vector<Index> last = current.cluster;
            assign(points, current);
            fill_empty(points, current);
            if (i > 0 && current.cluster == last) break;
            MatrixD sum = MatrixD::Zero(clusters, points.cols());
            VectorD count = VectorD::Zero(clusters);
            for (Index p = 0; p < points.rows(); ++p) {
                sum.row(current.cluster[at(p)]) += points.row(p);
                count(current.cluster[at(p)]) += 1;
            }
            current.centres = sum.array().colwise() / count.array();
        }
        if (current.cost < best.cost) best = std::move(current);
    }
    return best.cluster;
}

}  // namespace nacre
