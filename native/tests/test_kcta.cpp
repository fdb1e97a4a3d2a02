#include <algorithm>
#include <set>

#include "check.hpp"
#include "nacre/kcta.hpp"
#include "nacre/nsvd.hpp"

using namespace nacre;

namespace {

// Eq. 8: the sum over clusters of Z_c x_n U_n,c.
dense::Array reconstruct(const Kcta& model, const Shape& shape, const KctaOptions& options) {
    dense::Array result(shape);
    const std::size_t m = at(options.clustered);
    const Index rank = options.ranks[m], mixtures = options.mixtures;
    for (std::size_t c = 0; c < model.cores.size(); ++c) {
        MatrixD mixing = MatrixD::Zero(shape[m], rank);
        for (Index i = 0; i < shape[m]; ++i) {
            for (Index k = 0; k < mixtures; ++k) {
                if (model.members[at(i * mixtures + k)] != c) continue;
                for (Index r = 0; r < rank; ++r) {
                    mixing(i, r) = model.coefficients[at((i * mixtures + k) * rank + r)];
                }
            }
        }
        // U_m,c has orthonormal columns, as many as it has members, and the rest is zero.
        const MatrixD gram = mixing.transpose() * mixing;
        for (Index r = 0; r < rank; ++r) {
            for (Index s = 0; s < rank; ++s) {
                CHECK(std::abs(gram(r, s)) < 1e-5 || (r == s && std::abs(gram(r, s) - 1) < 1e-5));
            }
        }
        dense::Array part(model.cores[c]);
        for (std::size_t n = 0; n < shape.size(); ++n) {
            if (n == m) {
                part = dense::mode_product(part, n, mixing);
                continue;
            }
            const MatrixF& basis = model.bases[n][model.bases[n].size() == 1 ? 0 : c];
            CHECK(orthonormality_error(basis) < 1e-5);
            part = dense::mode_product(part, n, basis.cast<double>());
        }
        for (std::size_t i = 0; i < part.values.size(); ++i) result.values[i] += part.values[i];
    }
    return result;
}

MatrixD line(Index count) {
    MatrixD points(count, 1);
    for (Index i = 0; i < count; ++i) points(i, 0) = static_cast<double>(i);
    return points;
}

void check_model(const Tensor& tensor, const KctaOptions& options) {
    Executor executor(2), alone(1);
    const MemorySource source(tensor.data(), tensor.shape());
    const Kcta model = kcta(executor, source, options);
    const dense::Array array(tensor);
    const double distance = dense::distance(reconstruct(model, tensor.shape(), options), array);
    const double energy = std::max(array.squared_norm(), 1e-30);
    CHECK_NEAR(distance * distance / energy, model.errors.back(), 2e-5);
    for (std::size_t i = 1; i < model.errors.size(); ++i) {
        CHECK(model.errors[i] <= model.errors[i - 1]);
    }
    std::set<ClusterId> used;
    for (std::size_t i = 0; i < model.members.size(); ++i) {
        used.insert(model.members[i]);
        CHECK(i % at(options.mixtures) == 0 || model.members[i - 1] < model.members[i]);
    }
    CHECK(static_cast<Index>(used.size()) == options.clusters);  // none is empty

    const Kcta again = kcta(alone, source, options);  // the same bits on one thread
    CHECK(again.errors == model.errors && again.members == model.members);
    CHECK(again.coefficients == model.coefficients);
    for (std::size_t c = 0; c < model.cores.size(); ++c) {
        CHECK(std::equal(model.cores[c].data(), model.cores[c].data() + model.cores[c].size(),
                         again.cores[c].data()));
    }
}

KctaOptions options_for(const Shape& shape, const Shape& ranks, Index clustered, Index clusters,
                        Index mixtures, std::vector<Index> global) {
    KctaOptions options;
    options.ranks = ranks;
    options.clustered = clustered;
    options.clusters = clusters;
    options.mixtures = mixtures;
    options.global_modes = std::move(global);
    options.parameters = line(shape[at(clustered)]);
    options.iterations = 10;
    return options;
}

}  // namespace

int main() {
    const Shape shape{6, 14, 5, 4};
    const Tensor tensor = random_tensor(shape, 31);
    // Any clustered mode, any set of global ones, one to all mixture clusters.
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 1, {0}));
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 2, {0}));
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 4, {0}));
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 2, {}));
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 2, {2, 3}));
    check_model(tensor, options_for(shape, {3, 2, 3, 2}, 1, 4, 3, {0, 2, 3}));
    check_model(tensor, options_for(shape, {2, 6, 3, 2}, 0, 3, 2, {1}));
    check_model(tensor, options_for(shape, {3, 6, 3, 1}, 3, 2, 2, {0}));
    // As many clusters as rows, ranks above the members, full ranks, modes of one row.
    check_model(tensor, options_for(shape, {3, 4, 3, 2}, 1, 14, 2, {0}));
    check_model(tensor, options_for(shape, {6, 14, 5, 4}, 1, 3, 2, {0}));
    check_model(random_tensor({1, 9, 1, 3}, 3),
                options_for({1, 9, 1, 3}, {1, 2, 1, 2}, 1, 3, 2, {0}));
    // All rows alike: every row wants the same cluster and the empty ones are filled by splitting.
    Tensor constant(shape);
    constant.fill(0.7f);
    check_model(constant, options_for(shape, {2, 2, 2, 2}, 1, 5, 1, {0}));
    check_model(constant, options_for(shape, {2, 2, 2, 2}, 1, 5, 3, {0}));
    Tensor zero(shape);
    zero.fill(0);
    check_model(zero, options_for(shape, {2, 2, 2, 2}, 1, 5, 3, {0}));

    // One cluster without global bases is N-SVD (on a smooth tensor: noise has many optima).
    Executor executor(2);
    Tensor smooth(shape);
    const Unfolding rows = unfolding(shape, 1);
    for (Index i = 0; i < smooth.size(); ++i) {
        const Index view = i / rows.inner % rows.rows, rest = i / rows.inner / rows.rows;
        smooth.data()[i] = 1.0f / static_cast<float>(1 + i % rows.inner + 2 * view + rest * view);
    }
    const MemorySource source(smooth.data(), shape);
    KctaOptions one = options_for(shape, {3, 4, 3, 2}, 1, 1, 1, {});
    one.iterations = 60;
    one.tolerance = 1e-7;
    const double error = kcta(executor, source, one).errors.back();
    CHECK_NEAR(error, nsvd(executor, source, {one.ranks, 60, 1e-7}).errors.back(), 1e-6);

    // Arguments.
    const auto message = [&](const std::function<void(KctaOptions&)>& change) {
        KctaOptions options = options_for(shape, {3, 2, 3, 2}, 1, 4, 2, {0});
        change(options);
        return message_of([&] { kcta(executor, source, options); });
    };
    CHECK(message([](KctaOptions& o) { o.mixtures = 5; }) ==
          "mixtures: expected 1 to 4 (the clusters), got 5");
    CHECK(message([](KctaOptions& o) { o.clusters = 15; }) ==
          "clusters: expected 1 to 14 (the rows of the clustered mode), got 15");
    CHECK(message([](KctaOptions& o) { o.ranks[2] = 6; }) ==
          "ranks: expected 1 to 5 for mode 2, got 6");
    CHECK(message([](KctaOptions& o) { o.global_modes = {1}; }).starts_with("global_modes:"));
    CHECK(message([](KctaOptions& o) { o.parameters = line(3); }).starts_with("directions:"));
    std::puts("ok");
}
