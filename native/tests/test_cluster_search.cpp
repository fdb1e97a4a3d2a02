// Section 4.2 against the formulas written out in the original tensor space.
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

#include "check.hpp"
#include "nacre/cluster_search.hpp"
#include "nacre/kcta.hpp"

using namespace nacre;

namespace {

constexpr Index kClusters = 5, kRank = 2, kItems = 12;
const Shape kShape{kItems, 6, 5};  // clustered mode first
const Shape kCoreShape{kRank, 3, 4};

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

}  // namespace

int main() {
    Executor executor(2);
    const Model model = random_model();
    const Tensor tensor = random_tensor(kShape, 77);
    const dense::Array array(tensor);

    // Rows of `whole[c]` span cluster c in the original space: ufm(Z_c x_n U_n,c).
    std::vector<MatrixD> whole, cores;
    for (std::size_t c = 0; c < kClusters; ++c) {
        dense::Array expanded(model.cores[c]);
        cores.push_back(dense::unfold(expanded, 0));
        for (std::size_t n = 1; n < 3; ++n) {
            expanded = dense::mode_product(expanded, n, model.bases[n][c].cast<double>());
        }
        whole.push_back(dense::unfold(expanded, 0));
    }
    // Eq. 10: ufm(A<i>^(c)), rows by item.
    const auto reduced = [&](const dense::Array& a, std::size_t c) {
        dense::Array result = a;
        for (std::size_t n = 1; n < 3; ++n) {
            result = dense::mode_product(result, n, model.bases[n][c].cast<double>().transpose());
        }
        return dense::unfold(result, 0);
    };
    MatrixD projections(kItems, kClusters * kRank);
    for (std::size_t c = 0; c < kClusters; ++c) {
        projections.middleCols(static_cast<Index>(c) * kRank, kRank) =
            reduced(array, c) * cores[c].transpose();  // Eq. 18
    }

    // Eqs. 14 and 17.
    const MatrixD gram = core_gram(executor, model.cores, model.bases, 0);
    for (std::size_t j = 0; j < kClusters; ++j) {
        dense::Array expanded(model.cores[j]);
        for (std::size_t n = 1; n < 3; ++n) {
            expanded = dense::mode_product(expanded, n, model.bases[n][j].cast<double>());
        }
        for (std::size_t c = 0; c < kClusters; ++c) {
            const MatrixD expected = reduced(expanded, c) * cores[c].transpose();
            const MatrixD block = gram.block(static_cast<Index>(j) * kRank,
                                             static_cast<Index>(c) * kRank, kRank, kRank);
            CHECK((block - expected).cwiseAbs().maxCoeff() < 1e-5);
        }
    }

    // The greedy search, subtensor by subtensor.
    const MatrixD items = dense::unfold(array, 0);
    for (Index mixtures : {1, 2, 3, 5}) {
        const Membership found =
            search_clusters(executor, projections.data(), kItems, gram, kClusters, kRank, mixtures);
        for (Index i = 0; i < kItems; ++i) {
            std::vector<std::size_t> chosen;
            dense::Array residual({1, kShape[1], kShape[2]});
            VectorD coefficients;
            for (Index k = 0; k < mixtures; ++k) {
                // Eq. 12: the residual subtensor in the original space.
                VectorD rest = items.row(i);
                for (std::size_t j = 0; j < chosen.size(); ++j) {
                    rest -= whole[chosen[j]].transpose() *
                            coefficients.segment(static_cast<Index>(j) * kRank, kRank);
                }
                std::copy(rest.begin(), rest.end(), residual.values.begin());
                double most = -1;
                std::size_t best = 0;
                for (std::size_t c = 0; c < kClusters; ++c) {
                    if (std::count(chosen.begin(), chosen.end(), c)) continue;
                    // Eqs. 7, 9 and 13: || ufm(R^(c)) V_c^T ||^2.
                    const MatrixD dual = inverse_root(cores[c] * cores[c].transpose()) * cores[c];
                    const double norm = (reduced(residual, c) * dual.transpose()).squaredNorm();
                    // Theorems 1 and 3: that is the energy that cluster c explains of the rest.
                    const MatrixD basis = whole[c].transpose();
                    const double explained = (basis * (pseudo_inverse(basis) * rest)).squaredNorm();
                    CHECK_NEAR(norm, explained, 1e-6);
                    if (norm > most) {
                        most = norm;
                        best = c;
                    }
                }
                chosen.push_back(best);
                // Theorem 4 and Lemma 2: the least-squares coefficients in the original space.
                MatrixD all(items.cols(), static_cast<Index>(chosen.size()) * kRank);
                for (std::size_t j = 0; j < chosen.size(); ++j) {
                    all.middleCols(static_cast<Index>(j) * kRank, kRank) =
                        whole[chosen[j]].transpose();
                }
                coefficients = pseudo_inverse(all) * items.row(i).transpose();
            }
            std::vector<std::size_t> order(chosen.size());
            for (std::size_t j = 0; j < order.size(); ++j) order[j] = j;
            std::sort(order.begin(), order.end(),
                      [&](std::size_t a, std::size_t b) { return chosen[a] < chosen[b]; });
            for (Index k = 0; k < mixtures; ++k) {
                const std::size_t from = order[static_cast<std::size_t>(k)];
                const std::size_t entry = static_cast<std::size_t>(i * mixtures + k);
                CHECK(found.clusters[entry] == chosen[from]);
                for (std::size_t r = 0; r < kRank; ++r) {
                    CHECK_NEAR(found.coefficients[entry * kRank + r],
                               coefficients(static_cast<Index>(from * kRank + r)), 1e-4);
                }
            }
        }
    }

    // All sets as candidates: the search is then optimal.
    std::vector<ClusterId> sets;
    for (Index i = 0; i < kItems; ++i) {
        for (ClusterId a = 0; a < kClusters; ++a) {
            for (ClusterId b = 0; b < a; ++b) sets.insert(sets.end(), {a, b});
        }
    }
    const Index set_count = kClusters * (kClusters - 1) / 2;
    const Membership best = search_clusters(executor, projections.data(), kItems, gram, kClusters,
                                            kRank, 2, sets, set_count);
    for (Index i = 0; i < kItems; ++i) {
        double most = 0;
        for (std::size_t a = 0; a < kClusters; ++a) {
            for (std::size_t b = 0; b < a; ++b) {
                MatrixD both(items.cols(), 2 * kRank);
                both << whole[a].transpose(), whole[b].transpose();
                const VectorD item = items.row(i);
                most = std::max(most, (both * (pseudo_inverse(both) * item)).squaredNorm());
            }
        }
        VectorD sum = VectorD::Zero(items.cols());
        for (std::size_t k = 0; k < 2; ++k) {
            const std::size_t entry = static_cast<std::size_t>(2 * i) + k;
            const Eigen::Map<const VectorD> u(best.coefficients.data() + entry * kRank, kRank);
            sum += whole[best.clusters[entry]].transpose() * u;
        }
        CHECK_NEAR(sum.squaredNorm(), most, 1e-5);
    }

    // Two equal clusters, and one without energy: coefficients stay finite and are as good.
    MatrixD twin = MatrixD::Zero(6, 6);
    twin.topLeftCorner(4, 4) << 2, 1, 2, 1, 1, 3, 1, 3, 2, 1, 2, 1, 1, 3, 1, 3;
    const std::vector<double> row{1, 2, 1, 2, 0, 0};
    ClusterSearch search(twin, 3, 2);
    const ClusterSearch::Mixture single = search.greedy(row, 1), triple = search.greedy(row, 3);
    CHECK(single.clusters == std::vector<ClusterId>({0}));
    CHECK(triple.coefficients.allFinite() && triple.coefficients.norm() < 10);
    CHECK_NEAR(triple.energy, single.energy, 1e-9);
    CHECK_NEAR(single.energy, 1.4, 1e-9);  // a S^-1 a^T
    std::puts("ok");
}
