#include <algorithm>
#include <numeric>

#include "check.hpp"
#include "dictionary.hpp"
#include "nacre/blas.hpp"
#include "nacre/ensemble.hpp"

using namespace nacre;

namespace {

constexpr Index kPatches = 40, kSparsity = 6;
const Shape kShape = {3, 4, 6, 5};

Ensemble random_ensemble(Index count, std::uint64_t seed) {
    Ensemble ensemble;
    for (Index k = 0; k < count; ++k) {
        Dictionary dictionary;
        for (Index rows : kShape) dictionary.push_back(random_basis(rows, rows, seed++));
        ensemble.push_back(dictionary);
    }
    return ensemble;
}

// Patches of few coefficients in the dictionaries in turn.
std::vector<float> sparse_patches(const Ensemble& ensemble, std::uint64_t seed) {
    Random random(seed);
    std::vector<float> values;
    for (Index i = 0; i < kPatches; ++i) {
        dense::Array patch(kShape);
        for (Index c = 0; c < kSparsity; ++c) {
            patch.values[random.next() % patch.values.size()] = 1 + random.uniform();
        }
        const Dictionary& dictionary = ensemble[at(i) % ensemble.size()];
        for (std::size_t n = 0; n < kShape.size(); ++n) {
            patch = dense::mode_product(patch, n, dictionary[n].cast<double>());
        }
        for (double v : patch.values) values.push_back(static_cast<float>(v));
    }
    return values;
}

bool same(const Ensemble& a, const Ensemble& b) {
    for (std::size_t k = 0; k < a.size(); ++k) {
        for (std::size_t n = 0; n < a[k].size(); ++n) {
            if (a[k][n] != b[k][n]) return false;
        }
    }
    return a.size() == b.size();
}

bool same(const Training& a, const Training& b) {
    return same(a.ensemble, b.ensemble) && a.members == b.members && a.errors == b.errors &&
           a.orthonormality == b.orthonormality && a.sweeps == b.sweeps;
}

void check_falling(const Training& training) {
    CHECK(training.errors.size() == at(training.sweeps) + 1);
    for (std::size_t i = 1; i < training.errors.size(); ++i) {
        CHECK(training.errors[i] <= training.errors[i - 1] + 1e-6);
    }
    CHECK(training.orthonormality.size() == at(training.sweeps));
    for (double error : training.orthonormality) CHECK(error < 1e-6);
}

// What the largest coefficients of each patch leave in the best dictionary, computed densely.
double dense_objective(const std::vector<float>& values, const Ensemble& ensemble, Index sparsity) {
    double left = 0, total = 0;
    const std::size_t size = at(product(kShape));
    for (std::size_t i = 0; i < values.size() / size; ++i) {
        dense::Array patch(kShape);
        std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(i * size), size,
                    patch.values.begin());
        const double norm = patch.squared_norm();
        double least = norm;
        for (const Dictionary& dictionary : ensemble) {
            dense::Array s = patch;
            for (std::size_t n = 0; n < kShape.size(); ++n) {
                s = dense::mode_product(s, n, dictionary[n].cast<double>().transpose());
            }
            std::sort(s.values.begin(), s.values.end(),
                      [](double a, double b) { return std::abs(a) > std::abs(b); });
            double error = norm;
            for (std::size_t c = 0; c < at(sparsity); ++c) error -= s.values[c] * s.values[c];
            least = std::min(least, error);
        }
        left += least;
        total += norm;
    }
    return left / total;
}

void check_linear_algebra() {
    for (Index n : {1, 2, 7, 40}) {
        const MatrixD matrix = random_matrix(n, n, 3).cast<double>();
        MatrixD left = matrix, right;
        const VectorD values = singular_vectors(left, right);
        CHECK((left * values.asDiagonal() * right - matrix).cwiseAbs().maxCoeff() < 1e-12);
        CHECK(orthonormality_error(left.cast<float>()) < 1e-6);
        for (Index i = 0; i < n; ++i) CHECK(values(i) >= (i + 1 < n ? values(i + 1) : 0));
    }
    // The best of all orthonormal matrices, and nearest to the last one where there is a choice.
    const MatrixD target = random_matrix(6, 6, 8).cast<double>();
    const MatrixF last = random_basis(6, 6, 9), best = procrustes(target, last);
    CHECK(orthonormality_error(best) < 1e-6);
    const double gain = best.cast<double>().cwiseProduct(target).sum();
    MatrixD left = target, right;
    CHECK_NEAR(gain, singular_vectors(left, right).sum(), 1e-6);
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
        const MatrixD other = random_basis(6, 6, 20 + seed).cast<double>();
        CHECK(other.cwiseProduct(target).sum() <= gain + 1e-6);
    }
    CHECK(procrustes(MatrixD::Zero(6, 6), last) == last);
    MatrixD one = MatrixD::Zero(6, 6);
    one.col(2) = last.col(2).cast<double>();
    CHECK((procrustes(one, last) - last).cwiseAbs().maxCoeff() < 1e-6);
}

void check_training(const Patches& patches, const std::vector<float>& values) {
    Executor executor(3), alone(1);
    TrainingOptions options;
    options.dictionaries = 3;
    options.sparsity = kSparsity;
    options.sweeps = 12;
    options.tolerance = 0;
    for (int reassign : {1, 3}) {
        options.reassign = reassign;
        std::vector<Training> states;
        const Training whole = train(executor, patches, options, nullptr,
                                     [&](const Training& state) { states.push_back(state); });
        check_falling(whole);
        CHECK(whole.sweeps > 2 && static_cast<int>(states.size()) == whole.sweeps);
        CHECK(whole.errors.back() < 0.5 * whole.errors.front());
        CHECK_NEAR(whole.errors.back(), dense_objective(values, whole.ensemble, kSparsity), 1e-6);
        CHECK(same(train(alone, patches, options), whole));
        for (const Training& state : {states[0], states[states.size() / 2], states.back()}) {
            CHECK(same(train(alone, patches, options, &state), whole));
        }
        const SparseCode coded = code(executor, patches, whole.ensemble, kSparsity);
        CHECK(coded.members == whole.members);
        const double left = std::accumulate(coded.errors.begin(), coded.errors.end(), 0.0);
        CHECK_NEAR(left / whole.squared_norm, whole.errors.back(), 1e-6);
    }
    options.reassign = 1;
    options.tolerance = 0.05;
    options.sweeps = 50;
    const Training stopped = train(executor, patches, options);
    CHECK(stopped.sweeps < 50);
    options.sweeps = 0;
    CHECK(train(executor, patches, options).errors.size() == 1);
}

// More dictionaries than kinds of patches: some stay empty, and the objective falls all the same.
void check_empty() {
    const Index size = product(kShape);
    std::vector<float> values;
    for (Index i = 0; i < 8; ++i) {
        const Tensor patch = random_tensor(kShape, i == 7 ? 2 : 1);
        values.insert(values.end(), patch.data(), patch.data() + size);
    }
    const Patches patches(values.data(), SampleType::kFloat, 8, kShape);
    Executor executor(2);
    TrainingOptions options;
    options.dictionaries = 4;
    options.sparsity = 5;
    options.sweeps = 6;
    const Training training = train(executor, patches, options);
    check_falling(training);
    CHECK(*std::max_element(training.reseeded.begin(), training.reseeded.end()) > 0);
    // Zeros alone have no direction.
    std::fill(values.begin(), values.end(), 0.0f);
    const Training nothing = train(executor, patches, options);
    CHECK(nothing.errors.back() == 0);
    check_falling(nothing);
}

void check_coding(const Patches& patches, const std::vector<float>& values,
                  const Ensemble& planted) {
    Executor executor(2);
    const std::size_t size = at(product(kShape)), room = 20;
    // The planted coefficients come back: in the right dictionary, no more than there are.
    const SparseCode exact = code(executor, patches, planted, room, 1e-8);
    for (std::size_t i = 0; i < at(kPatches); ++i) {
        CHECK(exact.members[i] == i % planted.size());
        CHECK(exact.counts[i] >= 1 && exact.counts[i] <= at(kSparsity));
        CHECK(exact.errors[i] <= 1e-8 * static_cast<double>(size));
        dense::Array patch(kShape);
        for (std::size_t c = 0; c < room; ++c) {
            const float value = exact.values[i * room + c];
            CHECK((value != 0) == (c < exact.counts[i]));
            if (c > 0) CHECK(std::abs(value) <= std::abs(exact.values[i * room + c - 1]));
            patch.values[exact.positions[i * room + c]] += value;
        }
        for (std::size_t n = 0; n < kShape.size(); ++n) {
            patch = dense::mode_product(patch, n, planted[exact.members[i]][n].cast<double>());
        }
        for (std::size_t v = 0; v < size; ++v) {
            CHECK_NEAR(patch.values[v], static_cast<double>(values[i * size + v]), 2e-3);
        }
    }
    // With no error allowed the count decides, and then the least error.
    const SparseCode few = code(executor, patches, planted, 2);
    for (std::size_t i = 0; i < at(kPatches); ++i) CHECK(few.counts[i] == 2);
    const double left = std::accumulate(few.errors.begin(), few.errors.end(), 0.0);
    double total = 0;
    for (float v : values) total += static_cast<double>(v) * v;
    CHECK_NEAR(left / total, dense_objective(values, planted, 2), 1e-6);
}

}  // namespace

int main() {
    check_linear_algebra();
    const Ensemble planted = random_ensemble(3, 100);
    CHECK(orthonormality_error(planted) < 1e-6);
    const std::vector<float> values = sparse_patches(planted, 4);
    const Patches patches(values.data(), SampleType::kFloat, kPatches, kShape);
    check_training(patches, values);
    check_empty();
    check_coding(patches, values, planted);

    std::vector<float> bad = values;
    bad[at(product(kShape)) + 5] = NAN;
    const Patches broken(bad.data(), SampleType::kFloat, kPatches, kShape);
    Executor executor(2);
    CHECK(message_of([&] { code(executor, broken, planted, 3); }).find("patch 1") !=
          std::string::npos);
    TrainingOptions many;
    many.dictionaries = kPatches + 1;
    CHECK(message_of([&] { train(executor, patches, many); }).find("dictionaries") == 0);
    CHECK(message_of([&] { code(executor, patches, planted, 0); }).find("sparsity") == 0);
    std::puts("ok");
}
