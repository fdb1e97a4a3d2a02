// Random models in the middle of a fit, and what the papers' formulas make of them in the original
// tensor space.
#pragma once

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "check.hpp"
#include "cluster_state.hpp"
#include "decomposition_stage.hpp"

namespace nacre::dense {

// C clusters of rank R, K mixture clusters of each item of `tied` rows. None is empty unless there
// are fewer items.
inline Grouping random_grouping(Index rows, Index tied, Index count, Index mixtures, Index rank,
                                std::uint64_t seed) {
    Random random(seed);
    Grouping grouping;
    grouping.rows = rows;
    grouping.tied = tied;
    grouping.count = count;
    grouping.rank = rank;
    std::vector<ClusterId> of_item;
    for (Index item = 0; item < rows / tied; ++item) {
        std::vector<ClusterId> all;
        for (Index c = 0; c < count; ++c) {
            all.push_back(static_cast<ClusterId>((item + c) % count));
        }
        for (std::size_t i = all.size(); i > 2; --i) {  // not the first
            std::swap(all[i - 1], all[1 + random.next() % (i - 1)]);
        }
        std::sort(all.begin(), all.begin() + mixtures);
        of_item.insert(of_item.end(), all.begin(), all.begin() + mixtures);
    }
    grouping.assign(std::move(of_item), mixtures);
    return grouping;
}

// Cores and bases of random numbers; ranks has those of the modes after the clustered ones, 0 for a
// mode that is left in full.
inline ClusterState random_state(Executor& executor, const std::vector<Grouping>& groupings,
                                 const Shape& others, const std::vector<Index>& other_ranks,
                                 std::uint64_t seed) {
    Shape shape;
    std::vector<Index> ranks;
    for (const Grouping& grouping : groupings) {
        shape.push_back(grouping.rows);
        ranks.push_back(grouping.rank);
    }
    shape.insert(shape.end(), others.begin(), others.end());
    ranks.insert(ranks.end(), other_ranks.begin(), other_ranks.end());
    ClusterState state(groupings, shape, ranks);
    state.use_spread(Tensor({state.count() * state.core_rows(), state.columns()}));
    Tensor a, b;
    for (Index c = 0; c < state.count(); ++c) {
        Shape core;
        for (std::size_t n = 0; n < shape.size(); ++n) {
            core.push_back(ranks[n] > 0 ? ranks[n] : shape[n]);
        }
        state.cores[at(c)] = random_tensor(core, ++seed);
        for (std::size_t n = 0; n < shape.size(); ++n) {
            const Index mode = static_cast<Index>(n);
            if (mode < state.clustered()) {
                const Index members = static_cast<Index>(state.members(c, mode).size());
                state.bases[at(c)][n] = random_matrix(members, ranks[n], ++seed);
            } else if (ranks[n] > 0) {
                state.bases[at(c)][n] = random_basis(shape[n], ranks[n], ++seed);
            }
        }
        spread_core(executor, state, c, a, b);
    }
    return state;
}

// U_n,c, I x R: zero in the rows that are not the cluster's members.
inline MatrixD basis_of(const ClusterState& state, Index c, std::size_t n) {
    const MatrixD own = state.bases[at(c)][n].cast<double>();
    if (static_cast<Index>(n) >= state.clustered()) return own;
    MatrixD result = MatrixD::Zero(state.shape()[n], own.cols());
    const std::vector<Index>& members = state.members(c, static_cast<Index>(n));
    for (std::size_t i = 0; i < members.size(); ++i) {
        result.row(members[i]) = own.row(static_cast<Index>(i));
    }
    return result;
}

// Z_c x_n U_n,c over every mode but `skip` (MK-CTA, Eq. 7); over all of them where that is -1.
inline Array expanded(const ClusterState& state, Index c, Index skip = -1) {
    Array result(state.cores[at(c)]);
    for (std::size_t n = 0; n < state.shape().size(); ++n) {
        if (static_cast<Index>(n) == skip || state.ranks()[n] == 0) continue;
        result = mode_product(result, n, basis_of(state, c, n));
    }
    return result;
}

inline void add(Array& to, const Array& from, double factor) {
    for (std::size_t i = 0; i < to.values.size(); ++i) to.values[i] += factor * from.values[i];
}

// MK-CTA, Eq. 3: what all clusters but one (-1: all of them) leave over.
inline Array left_over(const ClusterState& state, const Array& a, Index but = -1) {
    Array result = a;
    for (Index c = 0; c < state.count(); ++c) {
        if (c != but) add(result, expanded(state, c), -1);
    }
    return result;
}

// The leading left singular vectors of the mode's unfolding.
inline MatrixD leading(const Array& a, std::size_t mode, Index rank) {
    const MatrixD rows = unfold(a, mode);
    const Eigen::SelfAdjointEigenSolver<MatrixD> solver(rows * rows.transpose());
    return solver.eigenvectors().rowwise().reverse().leftCols(rank);
}

// A x_n U_n^T over every mode that has a basis, but for one.
inline Array projected(const Array& a, const std::vector<MatrixD>& bases, std::size_t but = 99) {
    Array result = a;
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (n == but || bases[n].size() == 0) continue;
        result = mode_product(result, n, bases[n].transpose());
    }
    return result;
}

// N-SVD by sweeps of alternating least squares, each basis from the tensor projected on the others
// (De Lathauwer et al. 2000). Empty bases are first taken from the tensor projected on those found
// before: the truncated HOSVD. Rank 0 leaves a mode without a basis. Returns the approximation.
inline Array nsvd(const Array& a, const std::vector<Index>& ranks, int sweeps,
                  std::vector<MatrixD>& bases) {
    const auto update = [&](std::size_t n) {
        if (ranks[n] == 0) return;
        bases[n] = leading(projected(a, bases, n), n, std::min(ranks[n], a.shape[n]));
    };
    if (bases.empty()) {
        bases.resize(ranks.size());
        for (std::size_t n = 0; n < ranks.size(); ++n) update(n);
    }
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        for (std::size_t n = 0; n < ranks.size(); ++n) update(n);
    }
    Array result = projected(a, bases);
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (bases[n].size() > 0) result = mode_product(result, n, bases[n]);
    }
    return result;
}

// The post-process (Section 3.5.3): orthonormal columns with the same span, by singular value
// decomposition, as many as that has dimensions.
inline MatrixD orthonormal(const MatrixD& basis) {
    const Eigen::SelfAdjointEigenSolver<MatrixD> solver(basis.transpose() * basis);
    const VectorD values = solver.eigenvalues();  // ascending
    Index rank = 0;
    for (Index i = 0; i < values.size(); ++i) rank += values(i) > 1e-6 * values.maxCoeff();
    MatrixD result = (basis * solver.eigenvectors()).rightCols(rank);
    for (Index i = 0; i < rank; ++i) result.col(i).normalize();
    return result;
}

// Whether basis^T basis is 1 on the diagonal of its first `count` columns and 0 elsewhere.
inline bool has_orthonormal_columns(const MatrixD& basis, Index count) {
    MatrixD expected = MatrixD::Zero(basis.cols(), basis.cols());
    expected.topLeftCorner(count, count).setIdentity();
    return (basis.transpose() * basis - expected).cwiseAbs().maxCoeff() < 1e-5;
}

}  // namespace nacre::dense
