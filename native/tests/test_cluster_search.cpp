// The searches of both papers against their formulas written out in the original tensor space.
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

#include "check.hpp"
#include "nacre/cluster_search.hpp"
#include "nacre/core_gram.hpp"

using namespace nacre;

namespace {

constexpr Index kClusters = 5, kRank = 2, kRows = 12;
const Shape kShape{kRows, 6, 5};  // clustered mode first
const Shape kCoreShape{kRank, 3, 4};

using Set = std::vector<ClusterId>;

struct Model {
    std::vector<Tensor> cores;
    std::vector<std::vector<MatrixF>> bases;  // [mode][cluster]
};

Model random_model() {
    Model model;
    model.bases.resize(3);
    for (Index c = 0; c < kClusters; ++c) {
        const std::uint64_t seed = static_cast<std::uint64_t>(c) + 1;
        model.cores.push_back(random_tensor(kCoreShape, seed));
        for (std::size_t n = 1; n < 3; ++n) {
            model.bases[n].push_back(random_basis(kShape[n], kCoreShape[n], 10 * n + seed));
        }
    }
    return model;
}

MatrixD pseudo_inverse(const MatrixD& m) {
    return m.completeOrthogonalDecomposition().pseudoInverse();
}

// (S S^T)^(-1/2)
MatrixD inverse_root(const MatrixD& m) {
    const Eigen::JacobiSVD<MatrixD> svd(m, Eigen::ComputeFullU);
    const VectorD root = svd.singularValues().cwiseSqrt().cwiseInverse();
    return svd.matrixU() * root.asDiagonal() * svd.matrixU().transpose();
}

// All sets of K clusters in order.
std::vector<Set> all_sets(Index mixtures) {
    std::vector<Set> result;
    for (unsigned bits = 0; bits < 1u << kClusters; ++bits) {
        Set set;
        for (ClusterId c = 0; c < kClusters; ++c) {
            if (bits >> c & 1) set.push_back(c);
        }
        if (static_cast<Index>(set.size()) == mixtures) result.push_back(set);
    }
    std::sort(result.begin(), result.end());
    return result;
}

// A problem in the original space and reduced.
class Problem {
  public:
    Problem(Executor& executor, const Model& model, const Tensor& tensor) : array_(tensor) {
        items_ = dense::unfold(array_, 0);
        projections_.resize(kRows, kClusters * kRank);
        for (std::size_t c = 0; c < kClusters; ++c) {
            dense::Array expanded(model.cores[c]);
            cores_.push_back(dense::unfold(expanded, 0));
            bases_.push_back({model.bases[1][c].cast<double>(), model.bases[2][c].cast<double>()});
            for (std::size_t n = 1; n < 3; ++n) {
                expanded = dense::mode_product(expanded, n, bases_[c][n - 1]);
            }
            whole_.push_back(dense::unfold(expanded, 0));
            projections_.middleCols(static_cast<Index>(c) * kRank, kRank) =
                reduced(array_, c) * cores_[c].transpose();  // Eq. 18
        }
        gram_ = core_gram(executor, model.cores, model.bases, 0);
    }

    // Eq. 10: ufm(A<i>^(c)), rows by item.
    MatrixD reduced(const dense::Array& a, std::size_t c) const {
        dense::Array result = a;
        for (std::size_t n = 1; n < 3; ++n) {
            result = dense::mode_product(result, n, bases_[c][n - 1].transpose());
        }
        return dense::unfold(result, 0);
    }

    // Eqs. 14 and 17.
    void check_gram() const {
        for (std::size_t j = 0; j < kClusters; ++j) {
            for (std::size_t c = 0; c < kClusters; ++c) {
                const MatrixD expected = whole_[j] * whole_[c].transpose();
                const MatrixD block = gram_.block(static_cast<Index>(j) * kRank,
                                                  static_cast<Index>(c) * kRank, kRank, kRank);
                CHECK((block - expected).cwiseAbs().maxCoeff() < 1e-5);
            }
        }
    }

    // Columns span the clusters of a set: Z_n,i^(k) of MK-CTA, Eq. 5.
    MatrixD span_of(const Set& set) const {
        MatrixD all(items_.cols(), static_cast<Index>(set.size()) * kRank);
        for (std::size_t j = 0; j < set.size(); ++j) {
            all.middleCols(static_cast<Index>(j) * kRank, kRank) = whole_[set[j]].transpose();
        }
        return all;
    }

    // uf(A<i>) Z Z^+ uf(A<i>)^T, summed over the rows of an item (MK-CTA, Eqs. 4 and 11).
    double explained(Index item, Index tied, const Set& set) const {
        const MatrixD span = span_of(set);
        const MatrixD inverse = pseudo_inverse(span);
        double sum = 0;
        for (Index row = item * tied; row < (item + 1) * tied; ++row) {
            sum += items_.row(row).dot(span * (inverse * items_.row(row).transpose()));
        }
        return sum;
    }

    // MK-CTA, Algorithm 2.
    Set optimal(Index item, Index tied, Index mixtures) const {
        return best_of(all_sets(mixtures), item, tied);
    }

    // MK-CTA, Algorithm 3.
    Set greedy(Index item, Index tied, Index mixtures) const {
        Set set;
        for (Index k = 0; k < mixtures; ++k) {
            std::vector<Set> further;
            for (ClusterId c = 0; c < kClusters; ++c) {
                if (std::count(set.begin(), set.end(), c)) continue;
                further.push_back(set);
                further.back().push_back(c);
            }
            set = best_of(further, item, tied);
        }
        std::sort(set.begin(), set.end());
        return set;
    }

    // K-CTA, Section 4.2, row by row of an item.
    Set kcta(Index item, Index tied, Index mixtures) const {
        Set set;
        for (Index k = 0; k < mixtures; ++k) {
            double most = -1;
            ClusterId best = 0;
            for (ClusterId c = 0; c < kClusters; ++c) {
                if (std::count(set.begin(), set.end(), c)) continue;
                const double energy = residual_energy(item, tied, set, c);
                if (energy > most) {
                    most = energy;
                    best = c;
                }
            }
            set.push_back(best);
        }
        std::sort(set.begin(), set.end());
        return set;
    }

    // Whether the result has these sets, and the coefficients of Theorem 4 (MK-CTA: Eq. 8).
    void check(const Membership& found, Index tied, Index mixtures,
               const std::function<Set(Index)>& expected) const {
        CHECK(found.clusters.size() == at(kRows / tied * mixtures));
        CHECK(found.coefficients.size() == at(kRows * mixtures * kRank));
        for (Index item = 0; item < kRows / tied; ++item) {
            const Set set = expected(item);
            CHECK(std::equal(set.begin(), set.end(), found.clusters.begin() + item * mixtures));
            const MatrixD inverse = pseudo_inverse(span_of(set));
            for (Index row = item * tied; row < (item + 1) * tied; ++row) {
                const VectorD coefficients = inverse * items_.row(row).transpose();
                const Eigen::Map<const VectorD> own(
                    found.coefficients.data() + row * mixtures * kRank, mixtures * kRank);
                CHECK((own - coefficients).cwiseAbs().maxCoeff() < 1e-4);
            }
        }
    }

    ReducedItems reduced_items(Index tied) const {
        return {projections_.data(), kRows, tied, gram_, kClusters, kRank};
    }

  private:
    Set best_of(const std::vector<Set>& sets, Index item, Index tied) const {
        double most = -1;
        Set best;
        for (const Set& set : sets) {
            const double energy = explained(item, tied, set);
            if (energy > most) {
                most = energy;
                best = set;
            }
        }
        return best;
    }

    // || ufm(R^(c)) V_c^T ||^2 of the residual that the clusters of the set leave.
    double residual_energy(Index item, Index tied, const Set& set, std::size_t c) const {
        double sum = 0;
        for (Index row = item * tied; row < (item + 1) * tied; ++row) {
            // Eq. 12: the residual subtensor in the original space, after Theorem 4 and Lemma 2.
            VectorD rest = items_.row(row);
            if (!set.empty()) {
                const MatrixD span = span_of(set);
                rest -= span * (pseudo_inverse(span) * items_.row(row).transpose());
            }
            dense::Array residual({1, kShape[1], kShape[2]});
            std::copy(rest.begin(), rest.end(), residual.values.begin());
            // Eqs. 7, 9 and 13.
            const MatrixD dual = inverse_root(cores_[c] * cores_[c].transpose()) * cores_[c];
            const double norm = (reduced(residual, c) * dual.transpose()).squaredNorm();
            // Theorems 1 and 3: that is the energy that cluster c explains of the rest.
            const MatrixD basis = whole_[c].transpose();
            CHECK_NEAR(norm, (basis * (pseudo_inverse(basis) * rest)).squaredNorm(), 1e-6);
            sum += norm;
        }
        return sum;
    }

    dense::Array array_;
    MatrixD items_, projections_, gram_;
    std::vector<MatrixD> cores_, whole_;
    std::vector<std::array<MatrixD, 2>> bases_;
};

constexpr SearchMethod kAll[] = {SearchMethod::kKcta, SearchMethod::kGreedy,
                                 SearchMethod::kOptimal};

void check_searches(Executor& executor, const Problem& problem) {
    bool differ = false;
    for (Index tied : {1, 3}) {
        const ReducedItems items = problem.reduced_items(tied);
        for (Index mixtures : {1, 2, 3, 5}) {
            problem.check(search_clusters(executor, items, mixtures, SearchMethod::kKcta), tied,
                          mixtures, [&](Index i) { return problem.kcta(i, tied, mixtures); });
            problem.check(search_clusters(executor, items, mixtures, SearchMethod::kGreedy), tied,
                          mixtures, [&](Index i) { return problem.greedy(i, tied, mixtures); });
            problem.check(search_clusters(executor, items, mixtures, SearchMethod::kOptimal), tied,
                          mixtures, [&](Index i) { return problem.optimal(i, tied, mixtures); });
            for (Index i = 0; i < items.items(); ++i) {
                const Set greedy = problem.greedy(i, tied, mixtures);
                differ = differ || greedy != problem.kcta(i, tied, mixtures) ||
                         greedy != problem.optimal(i, tied, mixtures);
                CHECK(problem.explained(i, tied, greedy) <=
                      problem.explained(i, tied, problem.optimal(i, tied, mixtures)) + 1e-9);
            }
        }
    }
    CHECK(differ);  // else this would not tell them apart
}

void check_candidates(Executor& executor, const Problem& problem) {
    for (Index tied : {1, 2}) {
        const ReducedItems items = problem.reduced_items(tied);
        const std::vector<Set> sets = all_sets(2);
        // All sets as candidates, in any order of each: any search is then optimal.
        std::vector<ClusterId> all, reversed;
        for (Index i = 0; i < items.items(); ++i) {
            for (const Set& set : sets) {
                all.insert(all.end(), set.begin(), set.end());
                reversed.insert(reversed.end(), set.rbegin(), set.rend());
            }
        }
        for (SearchMethod method : kAll) {
            for (const std::vector<ClusterId>& candidates : {all, reversed}) {
                problem.check(search_clusters(executor, items, 2, method, candidates,
                                              static_cast<Index>(sets.size())),
                              tied, 2, [&](Index i) { return problem.optimal(i, tied, 2); });
            }
        }
        // One candidate wins where it explains more than what the search finds, only there.
        Index won = 0;
        std::vector<ClusterId> one;
        const auto other_set = [&](Index i) {
            return i % 4 == 0 ? sets.front() : problem.optimal(i, tied, 2);
        };
        for (Index i = 0; i < items.items(); ++i) {
            const Set set = other_set(i);
            one.insert(one.end(), set.begin(), set.end());
        }
        const auto better = [&](Index i) {
            const Set found = problem.kcta(i, tied, 2), other = other_set(i);
            const bool wins =
                problem.explained(i, tied, other) > problem.explained(i, tied, found) + 1e-9;
            won += wins;
            return wins ? other : found;
        };
        problem.check(search_clusters(executor, items, 2, SearchMethod::kKcta, one, 1), tied, 2,
                      better);
        CHECK(tied == 2 || (won > 0 && won < items.items()));
    }
}

// Two equal clusters, and one without energy: coefficients stay finite and are as good.
void check_deficient(Executor& executor) {
    MatrixD twin = MatrixD::Zero(6, 6);
    twin.topLeftCorner(4, 4) << 2, 1, 2, 1, 1, 3, 1, 3, 2, 1, 2, 1, 1, 3, 1, 3;
    const std::vector<double> row{1, 2, 1, 2, 0, 0};
    const ReducedItems items{row.data(), 1, 1, twin, 3, 2};
    for (SearchMethod method : kAll) {
        const Membership one = search_clusters(executor, items, 1, method);
        CHECK(one.clusters == Set({0}));
        for (Index mixtures : {1, 2, 3}) {
            const Membership found = search_clusters(executor, items, mixtures, method);
            CHECK(std::is_sorted(found.clusters.begin(), found.clusters.end()));
            VectorD u = VectorD::Zero(6);
            for (Index k = 0; k < mixtures; ++k) {
                for (Index r = 0; r < 2; ++r) {
                    u(found.clusters[at(k)] * 2 + r) = found.coefficients[at(k * 2 + r)];
                }
            }
            CHECK(u.allFinite() && u.norm() < 10);
            CHECK_NEAR(u.dot(twin * u), 1.4, 1e-9);  // a S^-1 a^T
        }
    }
    // No cluster has any energy: the first ones, with coefficients 0.
    const MatrixD nothing = MatrixD::Zero(6, 6);
    const std::vector<double> none(6, 0.0);
    for (SearchMethod method : kAll) {
        const Membership found =
            search_clusters(executor, {none.data(), 1, 1, nothing, 3, 2}, 2, method);
        CHECK(found.clusters == Set({0, 1}));
        CHECK(found.coefficients == std::vector<double>(4, 0.0));
    }
    // The factor of a generalised inverse: G L L^T G = G, for any brightness of the functions.
    const MatrixD span = random_matrix(6, 4, 3).cast<double>();  // 6 functions, 4 dimensions
    for (double bright : {1.0, 1e-8, 1e8}) {
        VectorD scale = VectorD::Ones(6);
        scale(1) = bright;
        const MatrixD gram = scale.asDiagonal() * (span * span.transpose()) * scale.asDiagonal();
        const MatrixD factor = inverse_factor(gram);
        CHECK(factor.rows() == 6 && factor.cols() == 4);
        const MatrixD unit = scale.cwiseInverse().asDiagonal();
        const MatrixD again = gram * (factor * factor.transpose()) * gram;
        CHECK((unit * (again - gram) * unit).cwiseAbs().maxCoeff() < 1e-9);
    }
}

// More items than one task takes, more sets than are held at a time; the same bits on one thread.
void check_many(Executor& executor) {
    constexpr Index kMany = 700, kCount = 20;
    const MatrixD span = random_matrix(kCount, 30, 1).cast<double>();
    const MatrixD rows = random_matrix(kMany, 30, 2).cast<double>();
    const MatrixD gram = span * span.transpose(), projections = rows * span.transpose();
    Executor alone(1);
    for (SearchMethod method : kAll) {
        const ReducedItems items{projections.data(), kMany, 1, gram, kCount, 1};
        const Membership found = search_clusters(executor, items, 3, method);
        const Membership again = search_clusters(alone, items, 3, method);
        CHECK(found.clusters == again.clusters && found.coefficients == again.coefficients);
        // What each item has, it also has alone.
        for (Index i : {0, 255, 256, 699}) {
            const ReducedItems one{projections.data() + i * kCount, 1, 1, gram, kCount, 1};
            const Membership single = search_clusters(executor, one, 3, method);
            for (Index k = 0; k < 3; ++k) {
                CHECK(single.clusters[at(k)] == found.clusters[at(i * 3 + k)]);
                CHECK_NEAR(single.coefficients[at(k)], found.coefficients[at(i * 3 + k)], 1e-12);
            }
        }
    }
}

}  // namespace

int main() {
    Executor executor(2);
    const Problem problem(executor, random_model(), random_tensor(kShape, 77));
    problem.check_gram();
    check_searches(executor, problem);
    check_candidates(executor, problem);
    check_deficient(executor);
    check_many(executor);
    std::puts("ok");
}
