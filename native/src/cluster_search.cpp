#include "nacre/cluster_search.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "nacre/errors.hpp"

namespace nacre {

namespace {

constexpr std::size_t kMaxFactorBytes = std::size_t{32} << 20;  // kept by one search

Eigen::Map<const VectorD> as_vector(std::span<const double> values) {
    return {values.data(), static_cast<Eigen::Index>(values.size())};
}

}  // namespace

MatrixD inverse_factor(const MatrixD& gram) {
    const Index n = gram.rows();
    VectorD scale(n);
    for (Index i = 0; i < n; ++i) {
        scale(i) = gram(i, i) > 0 ? 1 / std::sqrt(gram(i, i)) : 0;
    }
    const MatrixD correlation = scale.asDiagonal() * gram * scale.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<MatrixD> solver(correlation);
    const auto& values = solver.eigenvalues();  // ascending
    Index first = 0;
    while (first < n && values(first) <= kDependent * values(n - 1)) ++first;
    if (n > 0 && values(n - 1) <= 0) first = n;
    MatrixD factor(n, n - first);
    for (Index k = first; k < n; ++k) {
        factor.col(k - first) =
            scale.cwiseProduct(solver.eigenvectors().col(k)) / std::sqrt(values(k));
    }
    return factor;
}

std::size_t ClusterSearch::Hash::operator()(const std::vector<ClusterId>& set) const {
    std::size_t hash = 0;
    for (ClusterId c : set) hash = hash * 0x9e3779b97f4a7c15u + c + 1;
    return hash ^ (hash >> 29);
}

ClusterSearch::ClusterSearch(const MatrixD& gram, Index clusters, Index rank)
    : gram_(gram), clusters_(clusters), rank_(rank) {
    for (Index c = 0; c < clusters; ++c) {
        dual_.push_back(inverse_factor(gram.block(c * rank, c * rank, rank, rank)));
    }
}

const MatrixD& ClusterSearch::factor_of(const std::vector<ClusterId>& clusters) {
    const auto found = factors_.find(clusters);
    if (found != factors_.end()) return found->second;
    const Index count = static_cast<Index>(clusters.size());
    const std::size_t bytes = at(count * rank_) * at(count * rank_) * sizeof(double);
    if ((factors_.size() + 1) * bytes > kMaxFactorBytes) factors_.clear();
    MatrixD gram(count * rank_, count * rank_);
    for (Index i = 0; i < count; ++i) {
        for (Index j = 0; j < count; ++j) {
            gram.block(i * rank_, j * rank_, rank_, rank_) =
                gram_.block(clusters[at(i)] * rank_, clusters[at(j)] * rank_, rank_, rank_);
        }
    }
    return factors_.emplace(clusters, inverse_factor(gram)).first->second;
}

ClusterSearch::Mixture ClusterSearch::project(std::span<const double> projections,
                                              std::span<const ClusterId> clusters) {
    Mixture mixture;
    mixture.clusters.assign(clusters.begin(), clusters.end());
    std::sort(mixture.clusters.begin(), mixture.clusters.end());
    const MatrixD& factor = factor_of(mixture.clusters);
    VectorD chosen(factor.rows());
    for (std::size_t i = 0; i < mixture.clusters.size(); ++i) {
        chosen.segment(static_cast<Index>(i) * rank_, rank_) =
            as_vector(projections.subspan(at(mixture.clusters[i] * rank_), at(rank_)));
    }
    const VectorD reduced = factor.transpose() * chosen;
    mixture.coefficients = factor * reduced;
    mixture.energy = reduced.squaredNorm();
    return mixture;
}

ClusterSearch::Mixture ClusterSearch::greedy(std::span<const double> projections, Index mixtures) {
    Mixture mixture;
    VectorD residual = as_vector(projections);  // projections of what is left, on every cluster
    std::vector<ClusterId> chosen;
    for (Index k = 0; k < mixtures; ++k) {
        double most = -1;
        Index best = -1;
        for (Index c = 0; c < clusters_; ++c) {
            if (std::find(chosen.begin(), chosen.end(), c) != chosen.end()) continue;
            const double norm =
                (dual_[at(c)].transpose() * residual.segment(c * rank_, rank_)).squaredNorm();
            if (norm > most) {
                most = norm;
                best = c;
            }
        }
        chosen.push_back(static_cast<ClusterId>(best));
        mixture = project(projections, chosen);
        if (k + 1 == mixtures) break;
        residual = as_vector(projections);
        for (std::size_t i = 0; i < mixture.clusters.size(); ++i) {
            residual -= gram_.middleRows(mixture.clusters[i] * rank_, rank_).transpose() *
                        mixture.coefficients.segment(static_cast<Index>(i) * rank_, rank_);
        }
    }
    return mixture;
}

Membership search_clusters(Executor& executor, const double* projections, Index rows,
                           const MatrixD& gram, Index clusters, Index rank, Index mixtures,
                           std::span<const ClusterId> candidates, Index sets) {
    Membership result;
    result.clusters.resize(at(rows * mixtures));
    result.coefficients.resize(at(rows * mixtures * rank));
    std::vector<ClusterSearch> searches(at(executor.threads()),
                                        ClusterSearch(gram, clusters, rank));
    constexpr Index kChunk = 256;
    executor.parallel_for(
        (rows + kChunk - 1) / kChunk,
        [&](Index task, int worker) {
            ClusterSearch& search = searches[at(worker)];
            for (Index i = task * kChunk; i < std::min(rows, (task + 1) * kChunk); ++i) {
                const std::span row(projections + i * clusters * rank, at(clusters * rank));
                ClusterSearch::Mixture best = search.greedy(row, mixtures);
                for (Index s = 0; s < sets; ++s) {
                    const auto set =
                        candidates.subspan(at((i * sets + s) * mixtures), at(mixtures));
                    ClusterSearch::Mixture other = search.project(row, set);
                    if (other.energy > best.energy) best = std::move(other);
                }
                std::copy(best.clusters.begin(), best.clusters.end(),
                          result.clusters.begin() + i * mixtures);
                std::copy(best.coefficients.begin(), best.coefficients.end(),
                          result.coefficients.begin() + i * mixtures * rank);
            }
        },
        true);
    return result;
}

}  // namespace nacre
