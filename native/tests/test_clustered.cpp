// Whole fits: CTA, K-CTA and MK-CTA.
#include <algorithm>
#include <set>

#include "check.hpp"
#include "nacre/clustered.hpp"
#include "nacre/nsvd.hpp"

using namespace nacre;

namespace {

// A tensor in memory, `tied` rows of one mode belonging together.
class TiedSource : public MemorySource {
  public:
    TiedSource(const Tensor& tensor, Index mode, Index tied)
        : MemorySource(tensor.data(), tensor.shape()), mode_(mode), tied_(tied) {}
    Index granularity(Index mode) const override { return mode == mode_ ? tied_ : 1; }

  private:
    Index mode_, tied_;
};

struct Clusters {
    Index mode, count, mixtures;
};

MatrixD line(Index count) {
    MatrixD points(count, 1);
    for (Index i = 0; i < count; ++i) points(i, 0) = static_cast<double>(i);
    return points;
}

ClusteredOptions options_for(const TensorSource& source, const Shape& ranks,
                             const std::vector<Clusters>& clusters, std::vector<Index> global) {
    ClusteredOptions options;
    options.ranks = ranks;
    for (const auto& [mode, count, mixtures] : clusters) {
        const Index items = source.shape()[at(mode)] / source.granularity(mode);
        options.clustered.push_back({mode, count, mixtures, line(items)});
    }
    options.global_modes = std::move(global);
    options.iterations = 10;
    return options;
}

// Eq. 3 of the MK-CTA paper: the sum over clusters of Z_c x_n U_n,c. Checks each basis on the way.
dense::Array reconstruct(const ClusteredTucker& model, const TensorSource& source,
                         const ClusteredOptions& options) {
    const Shape& shape = source.shape();
    dense::Array result(shape);
    for (std::size_t c = 0; c < model.cores.size(); ++c) {
        // The cluster vector, last mode fastest.
        std::vector<Index> vector(options.clustered.size());
        Index rest = static_cast<Index>(c);
        for (std::size_t k = vector.size(); k-- > 0;) {
            vector[k] = rest % options.clustered[k].clusters;
            rest /= options.clustered[k].clusters;
        }
        dense::Array part(model.cores[c]);
        for (std::size_t n = 0; n < shape.size(); ++n) {
            const auto mode = std::find_if(
                options.clustered.begin(), options.clustered.end(),
                [&](const ClusteredMode& m) { return m.mode == static_cast<Index>(n); });
            if (mode == options.clustered.end()) {
                const MatrixF& basis = model.bases[n][model.bases[n].size() == 1 ? 0 : c];
                CHECK(orthonormality_error(basis) < 1e-5);
                part = dense::mode_product(part, n, basis.cast<double>());
                continue;
            }
            const std::size_t k = static_cast<std::size_t>(mode - options.clustered.begin());
            Index owner = 0;
            for (std::size_t q = 0; q < vector.size(); ++q) {
                if (q != k) owner = owner * options.clustered[q].clusters + vector[q];
            }
            const Index rank = options.ranks[n], mixtures = mode->mixtures;
            const Index tied = source.granularity(mode->mode);
            MatrixD basis = MatrixD::Zero(shape[n], rank);
            for (Index i = 0; i < shape[n]; ++i) {
                for (Index slot = 0; slot < mixtures; ++slot) {
                    if (model.members[k][at(i / tied * mixtures + slot)] != vector[k]) continue;
                    basis.row(i) =
                        model.bases[n][at(owner)].block(i, slot * rank, 1, rank).cast<double>();
                }
            }
            // As many orthonormal columns as there are members, and the rest is zero.
            const MatrixD gram = basis.transpose() * basis;
            const Index members = (basis.array() != 0).rowwise().any().count();
            MatrixD expected = MatrixD::Zero(rank, rank);
            const Index count = std::min(rank, members);
            expected.topLeftCorner(count, count).setIdentity();
            CHECK((gram - expected).cwiseAbs().maxCoeff() < 1e-5);
            part = dense::mode_product(part, n, basis);
        }
        for (std::size_t i = 0; i < part.values.size(); ++i) result.values[i] += part.values[i];
    }
    return result;
}

bool same(const ClusteredTucker& a, const ClusteredTucker& b) {
    if (a.errors != b.errors || a.members != b.members || a.bases != b.bases) return false;
    if (a.squared_norm != b.squared_norm || a.cores.size() != b.cores.size()) return false;
    for (std::size_t c = 0; c < a.cores.size(); ++c) {
        const Tensor &x = a.cores[c], &y = b.cores[c];
        if (x.shape() != y.shape() || !std::equal(x.data(), x.data() + x.size(), y.data())) {
            return false;
        }
    }
    return true;
}

ClusteredTucker fit(const TensorSource& source, const ClusteredOptions& options, int threads = 2,
                    const ClusteredTucker* start = nullptr,
                    const ClusteredCheckpoint& checkpoint = {}) {
    Executor executor(threads);
    Workspace workspace;
    return fit_clustered(executor, workspace, source, options, start, checkpoint);
}

void check_model(const TensorSource& source, const Tensor& tensor,
                 const ClusteredOptions& options) {
    std::vector<ClusteredTucker> states;
    const ClusteredTucker model =
        fit(source, options, 2, nullptr, [&](const ClusteredTucker& s) { states.push_back(s); });
    const dense::Array array(tensor);
    const double distance = dense::distance(reconstruct(model, source, options), array);
    const double energy = std::max(array.squared_norm(), 1e-30);
    CHECK_NEAR(distance * distance / energy, model.errors.back(), 2e-5);
    CHECK_NEAR(model.squared_norm / energy, array.squared_norm() / energy, 1e-5);
    for (std::size_t i = 1; i < model.errors.size(); ++i) {
        CHECK(model.errors[i] <= model.errors[i - 1]);
    }
    CHECK(model.members.size() == options.clustered.size());
    for (std::size_t k = 0; k < model.members.size(); ++k) {
        const ClusteredMode& mode = options.clustered[k];
        const std::vector<ClusterId>& members = model.members[k];
        CHECK(members.size() == at(mode.parameters.rows() * mode.mixtures));
        for (std::size_t i = 0; i < members.size(); ++i) {
            CHECK(i % at(mode.mixtures) == 0 || members[i - 1] < members[i]);
        }
        CHECK(std::set<ClusterId>(members.begin(), members.end()).size() == at(mode.clusters));
    }
    CHECK(same(fit(source, options, 1), model));
    CHECK(same(fit(source, options, 3), model));
    // From any of its states the fit ends the same.
    CHECK(states.size() + 1 >= model.errors.size());
    for (const ClusteredTucker& state : states) CHECK(same(fit(source, options, 2, &state), model));
}

void check_model(const Tensor& tensor, const Shape& ranks, const std::vector<Clusters>& clusters,
                 std::vector<Index> global, SearchMethod search = SearchMethod::kAuto) {
    const MemorySource source(tensor.data(), tensor.shape());
    ClusteredOptions options = options_for(source, ranks, clusters, std::move(global));
    options.search = search;
    check_model(source, tensor, options);
}

void check_tied(const Tensor& tensor, Index mode, Index tied, const Shape& ranks,
                const std::vector<Clusters>& clusters, std::vector<Index> global) {
    const TiedSource source(tensor, mode, tied);
    check_model(source, tensor, options_for(source, ranks, clusters, std::move(global)));
}

// Smooth in all modes, like materials.
Tensor smooth_tensor(const Shape& shape) {
    Tensor tensor(shape);
    Index i = 0;
    dense::for_each(shape, [&](const Shape& index) {
        double sum = 1;
        for (std::size_t n = 0; n < index.size(); ++n) {
            sum += static_cast<double>((n % 2 + 1) * at(index[n] * index[(n + 1) % index.size()]));
        }
        tensor.data()[i++] = static_cast<float>(1 / sum);
    });
    return tensor;
}

// The error never falls below that of fewer mixture clusters, whatever the search.
void check_searches(const Tensor& tensor) {
    const MemorySource source(tensor.data(), tensor.shape());
    for (SearchMethod search :
         {SearchMethod::kKcta, SearchMethod::kGreedy, SearchMethod::kOptimal}) {
        double last = 1;
        for (Index mixtures : {1, 2, 3}) {
            ClusteredOptions options =
                options_for(source, {2, 2, 2, 2}, {{0, 3, mixtures}, {1, 4, mixtures}}, {});
            options.search = search;
            const double error = fit(source, options).errors.back();
            CHECK(error < last);
            last = error;
        }
    }
    // auto is kcta for one clustered mode; for several it is optimal below three mixture clusters
    // and greedy from there on, in each mode.
    const auto with = [&](const std::vector<Clusters>& clusters, SearchMethod search) {
        ClusteredOptions options = options_for(source, {2, 2, 2, 2}, clusters, {});
        options.search = search;
        return fit(source, options);
    };
    const std::vector<Clusters> one{{1, 5, 3}}, two{{0, 4, 2}, {1, 5, 2}},
        three{{0, 4, 3}, {1, 5, 3}};
    CHECK(same(with(one, SearchMethod::kAuto), with(one, SearchMethod::kKcta)));
    CHECK(same(with(two, SearchMethod::kAuto), with(two, SearchMethod::kOptimal)));
    CHECK(same(with(three, SearchMethod::kAuto), with(three, SearchMethod::kGreedy)));
    CHECK(!same(with(three, SearchMethod::kGreedy), with(three, SearchMethod::kOptimal)));
    // With one mixture cluster they are all the same.
    const std::vector<Clusters> hard{{0, 4, 1}, {1, 5, 1}};
    CHECK(same(with(hard, SearchMethod::kKcta), with(hard, SearchMethod::kGreedy)));
    CHECK(same(with(hard, SearchMethod::kKcta), with(hard, SearchMethod::kOptimal)));
}

// Section 4.2: MK-CTA begins with one mixture cluster a mode, K-CTA does not.
void check_warm_up(const Tensor& tensor) {
    const MemorySource source(tensor.data(), tensor.shape());
    const auto mixtures_by_iteration = [&](const std::vector<Clusters>& clusters) {
        ClusteredOptions options = options_for(source, {2, 2, 2, 2}, clusters, {2});
        options.iterations = 8;
        options.tolerance = 0;
        std::vector<std::vector<Index>> seen;
        fit(source, options, 2, nullptr, [&](const ClusteredTucker& state) {
            if (state.cores.empty()) return;  // the global bases alone
            seen.push_back({});
            for (std::size_t k = 0; k < state.members.size(); ++k) {
                seen.back().push_back(static_cast<Index>(state.members[k].size()) /
                                      options.clustered[k].parameters.rows());
            }
        });
        return seen;
    };
    const auto several = mixtures_by_iteration({{0, 3, 2}, {1, 4, 3}});
    const std::vector<Index> hard{1, 1}, all{2, 3};
    const auto grown = std::find(several.begin(), several.end(), all);
    const auto warm_up = grown - several.begin();
    CHECK(warm_up >= 2 && warm_up <= 5 && grown != several.end());
    CHECK(std::all_of(several.begin(), grown, [&](auto& m) { return m == hard; }));
    CHECK(std::all_of(grown, several.end(), [&](auto& m) { return m == all; }));
    const auto one = mixtures_by_iteration({{1, 4, 3}});
    CHECK(one[0] == std::vector<Index>{1} && one[1] == std::vector<Index>{3});
}

void check_starts(const Tensor& tensor) {
    const MemorySource source(tensor.data(), tensor.shape());
    const ClusteredOptions options = options_for(source, {2, 2, 3, 2}, {{0, 3, 2}, {1, 4, 2}}, {3});
    const ClusteredTucker model = fit(source, options);
    // Any model of these shapes, with its errors or without; it only gets better.
    ClusteredTucker start = model;
    start.errors.clear();
    const ClusteredTucker more = fit(source, options, 2, &start);
    CHECK_NEAR(more.errors.front(), model.errors.back(), 1e-6);
    CHECK(more.errors.back() <= more.errors.front());
    // A first guess that ends there fills its mixture clusters up, with coefficients 0.
    ClusteredOptions none = options;
    none.iterations = 0;
    const ClusteredTucker first = fit(source, none);
    CHECK(first.errors.size() == 1 && first.members[0].size() == at(2 * tensor.dim(0)));
    const double distance =
        dense::distance(reconstruct(first, source, options), dense::Array(tensor));
    CHECK_NEAR(distance * distance / dense::Array(tensor).squared_norm(), first.errors[0], 1e-5);

    // Models of other shapes, or members that are not.
    const std::string wrong = "start: expected a model of the same shape and settings";
    const auto message = [&](const std::function<void(ClusteredTucker&)>& change) {
        ClusteredTucker other = model;
        change(other);
        return message_of([&] { fit(source, options, 2, &other); });
    };
    CHECK(message([](auto& m) { m.cores.pop_back(); }) == wrong);
    CHECK(message([](auto& m) { m.cores[3].reset({2, 2, 2, 3}); }) == wrong);
    CHECK(message([](auto& m) { m.bases.pop_back(); }) == wrong);
    CHECK(message([](auto& m) { m.bases[2].pop_back(); }) == wrong);
    CHECK(message([](auto& m) { m.bases[3].clear(); }) == wrong);
    CHECK(message([](auto& m) { m.bases[0][1] = m.bases[0][1].leftCols(2).eval(); }) == wrong);
    CHECK(message([](auto& m) { m.members.pop_back(); }) == wrong);
    CHECK(message([](auto& m) { m.members[1].pop_back(); }) == wrong);
    CHECK(message([](auto& m) { m.members[0][1] = 3; }) == wrong);
    CHECK(message([](auto& m) { std::swap(m.members[0][0], m.members[0][1]); }) == wrong);
    // Global bases alone: those must fit as well.
    const auto bases = [&](const std::function<void(ClusteredTucker&)>& change) {
        return message([&](auto& m) {
            m.cores.clear();
            m.members.clear();
            change(m);
        });
    };
    CHECK(bases([](auto&) {}) == "");
    CHECK(bases([](auto& m) { m.bases.clear(); }) == wrong);
    CHECK(bases([](auto& m) { m.bases[3].clear(); }) == wrong);
    CHECK(bases([](auto& m) { m.bases[3][0] = m.bases[3][0].leftCols(1).eval(); }) == wrong);
}

void check_arguments(const Tensor& tensor) {
    const TiedSource source(tensor, 0, 3);
    const auto message = [&](const std::function<void(ClusteredOptions&)>& change) {
        ClusteredOptions options = options_for(source, {3, 2, 3, 2}, {{0, 2, 1}, {1, 4, 2}}, {2});
        change(options);
        return message_of([&] { fit(source, options); });
    };
    CHECK(message([](auto& o) { o.clustered[1].mixtures = 5; }) ==
          "mixtures: expected 1 to 4 (the clusters) for mode 1, got 5");
    CHECK(message([](auto& o) { o.clustered[1].clusters = 15; }) ==
          "clusters: expected 1 to 14 for mode 1, got 15");
    CHECK(message([](auto& o) { o.clustered[0].clusters = 3; }) ==  // 6 rows, 3 a light
          "clusters: expected 1 to 2 for mode 0, got 3");
    CHECK(message([](auto& o) { o.clustered.clear(); }) ==
          "clusters: expected at least one clustered mode");
    CHECK(message([](auto& o) { o.clustered[1].mode = 0; }) ==
          "clusters: expected distinct modes from 0 to 3, got 0");
    CHECK(message([](auto& o) { o.clustered[1].mode = 4; }) ==
          "clusters: expected distinct modes from 0 to 3, got 4");
    CHECK(message([](auto& o) { o.ranks[2] = 6; }) == "ranks: expected 1 to 5 for mode 2, got 6");
    CHECK(message([](auto& o) { o.ranks.pop_back(); }) == "ranks: expected 4 numbers, got 3");
    CHECK(message([](auto& o) { o.global_modes = {1}; }).starts_with("global_modes:"));
    CHECK(message([](auto& o) { o.clustered[0].parameters = line(6); }) ==
          "directions: expected 2 rows for mode 0, got 6");
    CHECK(message([](auto& o) { o.clustered[0].parameters(0, 0) = NAN; }) ==
          "directions: expected finite numbers");
    CHECK(message([](auto& o) { o.iterations = -1; }).starts_with("iterations:"));
    CHECK(message([](auto& o) { o.tolerance = -1; }).starts_with("tolerance:"));
    // Numbers that are none, with and without a start.
    const ClusteredOptions options = options_for(source, {3, 2, 3, 2}, {{1, 4, 2}}, {});
    const ClusteredTucker model = fit(source, options);
    Tensor bad = tensor;
    bad.data()[17] = NAN;
    const TiedSource bad_source(bad, 0, 3);
    const std::string finite = "samples: expected finite numbers below 1e15 in magnitude";
    CHECK(message_of([&] { fit(bad_source, options); }) == finite);
    CHECK(message_of([&] { fit(bad_source, options, 2, &model); }) == finite);
}

}  // namespace

int main() {
    const Shape shape{6, 14, 5, 4};
    const Tensor tensor = random_tensor(shape, 31);
    // K-CTA: any clustered mode, any set of global ones, one to all mixture clusters.
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 1}}, {0});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 2}}, {0});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 4}}, {0});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 2}}, {});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 2}}, {2, 3});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 3}}, {0, 2, 3});
    check_model(tensor, {2, 6, 3, 2}, {{0, 3, 2}}, {1});
    check_model(tensor, {3, 6, 3, 1}, {{3, 2, 2}}, {0});
    check_model(tensor, {3, 2, 3, 2}, {{1, 4, 3}}, {0}, SearchMethod::kGreedy);
    // MK-CTA: two, three and all four modes; near and far from each other.
    check_model(tensor, {2, 2, 3, 2}, {{0, 2, 1}, {1, 4, 1}}, {2, 3});
    check_model(tensor, {2, 2, 3, 2}, {{0, 3, 2}, {1, 4, 2}}, {2, 3});
    check_model(tensor, {2, 2, 3, 2}, {{0, 3, 2}, {1, 4, 3}}, {3});
    check_model(tensor, {2, 2, 3, 2}, {{0, 3, 1}, {3, 2, 2}}, {});
    check_model(tensor, {2, 2, 2, 2}, {{1, 3, 2}, {2, 2, 1}}, {0}, SearchMethod::kKcta);
    check_model(tensor, {2, 2, 2, 2}, {{0, 2, 1}, {1, 3, 2}, {2, 2, 2}}, {});
    check_model(tensor, {1, 2, 2, 1}, {{0, 2, 2}, {1, 3, 3}, {2, 2, 1}, {3, 2, 1}}, {});
    // Tied rows, in a global mode as well.
    check_tied(tensor, 0, 3, {3, 2, 3, 2}, {{1, 4, 2}}, {0});
    check_tied(tensor, 0, 3, {2, 2, 3, 2}, {{0, 2, 2}, {1, 4, 2}}, {2, 3});
    check_tied(tensor, 0, 2, {2, 2, 3, 2}, {{0, 3, 1}, {1, 4, 3}}, {2});
    check_tied(tensor, 1, 2, {2, 2, 3, 2}, {{1, 3, 2}}, {});
    // As many clusters as items, ranks above the members, full ranks, modes of one row.
    check_model(tensor, {3, 4, 3, 2}, {{1, 14, 2}}, {0});
    check_model(tensor, {2, 2, 3, 2}, {{0, 6, 2}, {1, 14, 1}}, {2});
    check_model(tensor, {6, 14, 5, 4}, {{1, 3, 2}}, {0});
    check_model(tensor, {6, 14, 5, 4}, {{0, 3, 1}, {1, 3, 2}}, {});
    check_model(random_tensor({1, 9, 1, 3}, 3), {1, 2, 1, 2}, {{1, 3, 2}}, {0});
    check_model(random_tensor({1, 9, 1, 3}, 3), {1, 2, 1, 2}, {{0, 1, 1}, {1, 3, 2}}, {});
    check_model(random_tensor({1, 1, 1}, 3), {1, 1, 1}, {{0, 1, 1}, {1, 1, 1}, {2, 1, 1}}, {});
    // All rows alike: every row wants the same cluster and the empty ones are filled by splitting.
    Tensor constant(shape);
    constant.fill(0.7f);
    check_model(constant, {2, 2, 2, 2}, {{1, 5, 1}}, {0});
    check_model(constant, {2, 2, 2, 2}, {{1, 5, 3}}, {0});
    check_model(constant, {2, 2, 2, 2}, {{0, 3, 1}, {1, 5, 1}}, {2});
    check_model(constant, {2, 2, 2, 2}, {{0, 3, 2}, {1, 5, 3}}, {});
    check_tied(constant, 0, 2, {2, 2, 2, 2}, {{0, 3, 1}, {1, 5, 2}}, {});
    Tensor zero(shape);
    zero.fill(0);
    check_model(zero, {2, 2, 2, 2}, {{1, 5, 3}}, {0});
    check_model(zero, {2, 2, 2, 2}, {{0, 3, 2}, {1, 5, 3}}, {2});

    // One cluster without global bases is N-SVD (on a smooth tensor: noise has many optima).
    const Tensor smooth = smooth_tensor(shape);
    const MemorySource source(smooth.data(), shape);
    Executor executor(2);
    const double best = nsvd(executor, source, {{3, 4, 3, 2}, 60, 1e-7}).errors.back();
    for (const std::vector<Clusters>& clusters : {std::vector<Clusters>{{1, 1, 1}},
                                                  {{0, 1, 1}, {1, 1, 1}},
                                                  {{0, 1, 1}, {2, 1, 1}, {3, 1, 1}}}) {
        ClusteredOptions one = options_for(source, {3, 4, 3, 2}, clusters, {});
        one.iterations = 60;
        one.tolerance = 1e-7;
        CHECK_NEAR(fit(source, one).errors.back(), best, 1e-6);
    }
    check_searches(random_tensor({8, 14, 5, 4}, 8));
    check_warm_up(random_tensor({8, 14, 5, 4}, 8));
    check_starts(tensor);
    check_arguments(tensor);
    std::puts("ok");
}
