// The decomposition stage against Eqs. 12 to 14 of the MK-CTA paper in the original tensor space.
#include "clustering_stage.hpp"
#include "decomposition_stage.hpp"
#include "dense_clusters.hpp"

using namespace nacre;

namespace {

// A x_n M_n,c^T: the rows of c's members (Eqs. 13 and 14), and back.
dense::Array members_of(const ClusterState& state, Index c, const dense::Array& a) {
    Shape shape = a.shape;
    for (Index k = 0; k < state.clustered(); ++k) {
        shape[at(k)] = static_cast<Index>(state.members(c, k).size());
    }
    dense::Array result(shape);
    dense::for_each(shape, [&](const Shape& index) {
        Shape from = index;
        for (Index k = 0; k < state.clustered(); ++k) {
            from[at(k)] = state.members(c, k)[at(index[at(k)])];
        }
        result[index] = a[from];
    });
    return result;
}

void put_members(const ClusterState& state, Index c, const dense::Array& part, dense::Array& to) {
    dense::for_each(part.shape, [&](const Shape& index) {
        Shape where = index;
        for (Index k = 0; k < state.clustered(); ++k) {
            where[at(k)] = state.members(c, k)[at(index[at(k)])];
        }
        to[where] = part[index];
    });
}

bool share_elements(const ClusterState& state, Index c, Index d) {
    for (Index k = 0; k < state.clustered(); ++k) {
        const std::vector<Index>&a = state.members(c, k), &b = state.members(d, k);
        const auto in_b = [&](Index row) { return std::count(b.begin(), b.end(), row) > 0; };
        if (std::none_of(a.begin(), a.end(), in_b)) return false;
    }
    return true;
}

// Clusters by the first batch of them that they share no element with: a batch may be decomposed at
// the same time (Section 3.6).
std::vector<Index> order_of(const ClusterState& state) {
    std::vector<std::vector<Index>> batches;
    for (Index c = 0; c < state.count(); ++c) {
        std::size_t batch = 0;
        while (batch < batches.size() &&
               std::any_of(
                   batches[batch].begin(), batches[batch].end(),
                   [&](Index d) { return share_elements(state, c, d); })) {
            ++batch;
        }
        if (batch == batches.size()) batches.push_back({});
        batches[batch].push_back(c);
    }
    std::vector<Index> order;
    for (const auto& batch : batches) order.insert(order.end(), batch.begin(), batch.end());
    return order;
}

// Two updates of every cluster, the first one from nothing where `fresh`.
void check_stage(const std::vector<Grouping>& groupings, const Shape& others,
                 const std::vector<Index>& other_ranks, std::uint64_t seed, bool fresh) {
    constexpr int kFreshSweeps = 2;
    Executor executor(2), alone(1), three(3);
    Workspace workspace;
    const ClusterState begin = dense::random_state(executor, groupings, others, other_ranks, seed);
    const Tensor tensor = random_tensor(begin.shape(), seed + 999);
    const dense::Array array(tensor);
    const double scale = std::sqrt(array.squared_norm());

    const auto fit = [&](Executor& threads, ClusterState& state, Tensor& left) {
        left = tensor;
        DecompositionStage stage(threads, workspace, state);
        if (fresh) {
            for (Index c = 0; c < state.count(); ++c) {
                state.cores[at(c)] = Tensor();
                state.bases[at(c)].assign(state.shape().size(), MatrixF());
            }
            stage.run(left, kFreshSweeps);
        } else {
            residual(threads, state, tensor, left);
            stage.run(left, 1);
        }
        stage.run(left, 1);
    };
    ClusterState state = begin;
    Tensor left;
    fit(executor, state, left);

    // The same in the original space. parts[c]: the approximation by cluster c.
    std::vector<dense::Array> parts(at(state.count()), dense::Array(state.shape()));
    std::vector<std::vector<MatrixD>> bases(at(state.count()));
    for (Index c = 0; c < state.count() && !fresh; ++c) {
        parts[at(c)] = dense::expanded(begin, c);
        for (std::size_t n = 0; n < state.shape().size(); ++n) {
            const MatrixD u = begin.bases[at(c)][n].cast<double>();
            const bool clustered = static_cast<Index>(n) < state.clustered();
            bases[at(c)].push_back(clustered && u.size() > 0 ? dense::orthonormal(u) : u);
        }
    }
    for (int round = 0; round < 2; ++round) {
        for (Index c : order_of(state)) {
            dense::Array rest = array;  // Eq. 12
            for (Index d = 0; d < state.count(); ++d) {
                if (d != c) dense::add(rest, parts[at(d)], -1);
            }
            const dense::Array own = members_of(state, c, rest);
            if (own.values.empty()) continue;
            const int sweeps = fresh && round == 0 ? kFreshSweeps : 1;
            put_members(state, c, dense::nsvd(own, state.ranks(), sweeps, bases[at(c)]),
                        parts[at(c)]);
        }
    }
    for (Index c = 0; c < state.count(); ++c) {
        if (members_of(state, c, array).values.empty()) continue;
        CHECK(dense::distance(dense::expanded(state, c), parts[at(c)]) < 1e-4 * scale);
        for (std::size_t n = 0; n < state.shape().size(); ++n) {
            if (state.ranks()[n] == 0) continue;
            const MatrixD basis = state.bases[at(c)][n].cast<double>();
            const Index count = std::min(state.ranks()[n], basis.rows());
            CHECK(dense::has_orthonormal_columns(basis, count));
        }
    }
    // The residual has stayed the tensor less its approximation.
    CHECK(dense::distance(dense::Array(left), dense::left_over(state, array)) < 1e-5 * scale);
    CHECK(dense::Array(left).squared_norm() < array.squared_norm());

    for (Executor* other : {&alone, &three}) {
        ClusterState again = begin;
        Tensor again_left;
        fit(*other, again, again_left);
        CHECK(std::equal(left.data(), left.data() + left.size(), again_left.data()));
        for (Index c = 0; c < state.count(); ++c) CHECK(again.bases[at(c)] == state.bases[at(c)]);
    }
}

Grouping mode(Index rows, Index tied, Index count, Index mixtures, Index rank) {
    const std::uint64_t seed = static_cast<std::uint64_t>(11 * rows + count);
    return dense::random_grouping(rows, tied, count, mixtures, rank, seed);
}

}  // namespace

int main() {
    for (bool fresh : {false, true}) {
        check_stage({mode(9, 1, 3, 2, 3)}, {5, 4}, {2, 0}, 1, fresh);
        check_stage({mode(6, 1, 2, 1, 2), mode(9, 1, 3, 1, 2)}, {5, 4}, {2, 0}, 2, fresh);
        check_stage({mode(6, 2, 3, 2, 2), mode(7, 1, 3, 1, 2)}, {4, 5}, {2, 3}, 3, fresh);
        check_stage({mode(8, 2, 2, 2, 2), mode(7, 1, 3, 2, 2)}, {4, 5}, {0, 0}, 4, fresh);
        check_stage({mode(4, 1, 2, 1, 2), mode(6, 1, 3, 2, 1), mode(5, 1, 2, 1, 2)}, {6}, {2}, 5,
                    fresh);
        // Ranks above the members (but none that the other ranks cannot fill, where any direction
        // does).
        check_stage({mode(5, 1, 4, 1, 2), mode(5, 1, 4, 2, 3)}, {4}, {2}, 6, fresh);
    }
    // Clusters without members stay as they are.
    check_stage({mode(3, 1, 6, 1, 2), mode(4, 1, 3, 1, 2)}, {4, 3}, {2, 0}, 7, false);
    std::puts("ok");
}
