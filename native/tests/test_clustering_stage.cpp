// The clustering stage's products against their formulas in the original tensor space.
#include "clustering_stage.hpp"
#include "dense_clusters.hpp"

using namespace nacre;

namespace {

// The rows of Z^_n^(1), Z^_n^(2) ... (Eqs. 5 to 7): by cluster of mode k, then by owner.
MatrixD subsets(const ClusterState& state, Index k) {
    const Grouping& own = state.groupings[at(k)];
    const Index owners = state.owners(k);
    Index columns = 1;
    for (std::size_t n = 0; n < state.shape().size(); ++n) {
        if (n != at(k)) columns *= state.shape()[n];
    }
    MatrixD result(own.count * owners * own.rank, columns);
    for (Index c = 0; c < state.count(); ++c) {
        const Index row = (state.part(c, k) * owners + state.owner(c, k)) * own.rank;
        result.middleRows(row, own.rank) = dense::unfold(dense::expanded(state, c, k), at(k));
    }
    return result;
}

// Whether two clusters have a common member in every clustered mode but k, item by item.
bool share_items(const ClusterState& state, Index c, Index d, Index k) {
    for (Index q = 0; q < state.clustered(); ++q) {
        if (q == k) continue;
        const Grouping& other = state.groupings[at(q)];
        bool common = false;
        for (Index item = 0; item < other.items(); ++item) {
            const ClusterId* set = other.of_item.data() + item * other.mixtures;
            const auto has = [&](Index part) {
                return std::count(set, set + other.mixtures, static_cast<ClusterId>(part)) > 0;
            };
            common = common || (has(state.part(c, q)) && has(state.part(d, q)));
        }
        if (!common) return false;
    }
    return true;
}

double largest(const MatrixD& m) { return m.size() > 0 ? m.cwiseAbs().maxCoeff() : 0; }

// Returns the number of blocks of Eq. 17 that must be zero.
Index check_stage(const std::vector<Grouping>& groupings, const Shape& others,
                  const std::vector<Index>& ranks, std::uint64_t seed) {
    Executor executor(2), alone(1);
    const ClusterState state = dense::random_state(executor, groupings, others, ranks, seed);
    const Tensor tensor = random_tensor(state.shape(), seed + 999);
    const dense::Array array(tensor);
    const MatrixD spreads = spread_gram(executor, state);
    CHECK(spreads == spread_gram(alone, state));
    Index zero_blocks = 0;
    for (Index k = 0; k < state.clustered(); ++k) {
        const MatrixD rows = subsets(state, k);
        // Eq. 16: uf_n(A<i>) Z^.
        const MatrixD projections = subset_projections(executor, state, k, tensor);
        const MatrixD expected = dense::unfold(array, at(k)) * rows.transpose();
        CHECK(projections.rows() == expected.rows() && projections.cols() == expected.cols());
        CHECK(largest(projections - expected) < 1e-5 * largest(expected));
        CHECK(projections == subset_projections(alone, state, k, tensor));
        // Eq. 17: Z^^T Z^.
        const MatrixD gram = subset_gram(executor, state, k, spreads);
        const MatrixD products = rows * rows.transpose();
        CHECK(gram.rows() == products.rows() && gram.cols() == products.cols());
        CHECK(largest(gram - products) < 1e-5 * largest(products));
        CHECK(largest(gram - gram.transpose()) < 1e-12 * largest(gram));
        const Index rank = state.groupings[at(k)].rank, owners = state.owners(k);
        const auto row = [&](Index c) {
            return (state.part(c, k) * owners + state.owner(c, k)) * rank;
        };
        for (Index c = 0; c < state.count(); ++c) {
            for (Index d = 0; d < state.count(); ++d) {
                if (share_items(state, c, d, k)) continue;
                CHECK(largest(gram.block(row(c), row(d), rank, rank)) == 0);
                ++zero_blocks;
            }
        }
    }
    // A less its approximation, Eq. 3.
    Tensor left(state.shape()), again(state.shape());
    residual(executor, state, tensor, left);
    residual(alone, state, tensor, again);
    CHECK(std::equal(left.data(), left.data() + left.size(), again.data()));
    const dense::Array whole = dense::left_over(state, array);
    CHECK(dense::distance(dense::Array(left), whole) < 1e-5 * std::sqrt(whole.squared_norm()));
    return zero_blocks;
}

Grouping mode(Index rows, Index tied, Index count, Index mixtures, Index rank) {
    const std::uint64_t seed = static_cast<std::uint64_t>(7 * rows + count);
    return dense::random_grouping(rows, tied, count, mixtures, rank, seed);
}

}  // namespace

int main() {
    // One clustered mode: K-CTA, whose clusters all overlap in the other modes.
    CHECK(check_stage({mode(9, 1, 4, 2, 3)}, {5, 4}, {2, 0}, 1) == 0);
    CHECK(check_stage({mode(9, 3, 2, 1, 2)}, {5, 4, 3}, {0, 0, 2}, 2) == 0);
    // Hard clusters: zero wherever the other mode's clusters differ, for 6 x 4 and 6 x 3 pairs.
    CHECK(check_stage({mode(6, 1, 2, 1, 2), mode(7, 1, 3, 1, 3)}, {5, 4}, {2, 3}, 3) == 24 + 18);
    // Mixtures in one, in both; tied rows; all clusters; a cluster without members.
    CHECK(check_stage({mode(6, 1, 3, 2, 2), mode(7, 1, 4, 1, 3)}, {5, 4}, {2, 0}, 4) > 0);
    check_stage({mode(6, 2, 3, 2, 2), mode(7, 1, 4, 2, 3)}, {5, 4}, {0, 2}, 5);
    check_stage({mode(6, 3, 2, 2, 1), mode(5, 1, 3, 3, 1)}, {4}, {0}, 6);
    CHECK(check_stage({mode(3, 1, 6, 1, 2), mode(4, 1, 3, 2, 1)}, {3, 5}, {3, 0}, 7) > 0);
    // Three and all four modes; rank 1; no other mode at all.
    check_stage({mode(4, 2, 2, 1, 2), mode(5, 1, 3, 2, 1), mode(3, 1, 2, 1, 3)}, {6}, {2}, 8);
    check_stage(
        {mode(4, 2, 2, 2, 1), mode(4, 1, 2, 1, 2), mode(3, 1, 3, 2, 2), mode(5, 1, 2, 1, 2)}, {},
        {}, 9);
    // More columns than are handled at a time.
    check_stage({mode(3, 1, 2, 1, 2), mode(4, 2, 2, 2, 1)}, {2, 1, 2100}, {2, 0, 0}, 10);
    check_stage({mode(5, 1, 3, 2, 1)}, {4200}, {0}, 11);
    std::puts("ok");
}
