#include "check.hpp"
#include "dense_algebra.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/nsvd.hpp"

using namespace nacre;

namespace {

dense::Array reconstruct(const Tensor& core, const std::vector<MatrixF>& bases) {
    dense::Array result(core);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (bases[n].size()) result = dense::mode_product(result, n, bases[n].cast<double>());
    }
    return result;
}

// Alternating least squares as De Lathauwer et al. write it, from the truncated HOSVD.
double reference_error(const dense::Array& a, const Shape& ranks, int sweeps) {
    std::vector<MatrixD> bases;
    const auto basis_of = [](const dense::Array& t, std::size_t n, Index rank) {
        return MatrixD(dense::svd(dense::unfold(t, n)).u.leftCols(rank));
    };
    for (std::size_t n = 0; n < ranks.size(); ++n) bases.push_back(basis_of(a, n, ranks[n]));
    for (int s = 0; s < sweeps; ++s) {
        for (std::size_t n = 0; n < ranks.size(); ++n) {
            dense::Array projected = a;
            for (std::size_t k = 0; k < ranks.size(); ++k) {
                if (k != n) projected = dense::mode_product(projected, k, bases[k].transpose());
            }
            bases[n] = basis_of(projected, n, ranks[n]);
        }
    }
    dense::Array core = a;
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        core = dense::mode_product(core, n, bases[n].transpose());
    }
    return 1 - core.squared_norm() / a.squared_norm();
}

// The same bits.
void check_same(const Tucker& a, const Tucker& b) {
    CHECK(a.core.shape() == b.core.shape());
    CHECK(std::equal(a.core.data(), a.core.data() + a.core.size(), b.core.data()));
    for (std::size_t n = 0; n < a.bases.size(); ++n) CHECK(a.bases[n] == b.bases[n]);
    CHECK(a.errors == b.errors && a.iterations == b.iterations);
    CHECK(a.squared_norm == b.squared_norm);
}

// A fit that stops after any iteration and is taken up again, one in files: the same bits.
void check_resumes(Executor& executor, const Tensor& tensor, const std::vector<Index>& ranks,
                   double passes) {
    const MemorySource source(tensor);
    std::vector<Tucker> states;
    NsvdOptions options{ranks, 3, 0};
    options.checkpoint = [&](const Tucker& state) { states.push_back(state); };
    const Tucker whole = nsvd(executor, source, options);
    CHECK(whole.iterations == 3 && whole.errors.size() == 3 && states.size() == 3);
    CHECK(source.passes() == passes);
    options.checkpoint = {};
    for (const Tucker& state : states) {
        options.start = &state;
        check_same(nsvd(executor, source, options), whole);
    }
    options.start = nullptr;
#if defined(__linux__)
    options.workspace = Workspace(1);
    const Tucker mapped = nsvd(executor, source, options);
    CHECK(mapped.core.mapped());
    check_same(mapped, whole);
#endif
}

}  // namespace

int main() {
    Executor executor(2);
    const Shape shape{6, 7, 8, 5}, ranks{3, 2, 4, 3};
    const Tensor tensor = random_tensor(shape, 21);
    const dense::Array array(tensor);
    const MemorySource source(tensor.data(), shape);

    const Tucker tucker = nsvd(executor, source, {ranks, 50, 1e-7});
    for (const MatrixF& basis : tucker.bases) CHECK(orthonormality_error(basis) < 1e-6);
    for (std::size_t i = 1; i < tucker.errors.size(); ++i) {
        CHECK(tucker.errors[i] <= tucker.errors[i - 1]);
    }
    const double distance = dense::distance(reconstruct(tucker.core, tucker.bases), array);
    CHECK_NEAR(distance * distance / array.squared_norm(), tucker.errors.back(), 1e-5);
    CHECK_NEAR(tucker.errors.back(), reference_error(array, ranks, 100), 1e-3);
    CHECK_NEAR(tucker.squared_norm, array.squared_norm(), 1e-5 * array.squared_norm());

    // A tensor of these ranks is found exactly; full ranks leave nothing.
    Tensor low = random_tensor(ranks, 5), scratch, out;
    std::vector<MatrixF> bases;
    for (std::size_t n = 0; n < 4; ++n) bases.push_back(random_basis(shape[n], ranks[n], n));
    multi_mode_product(executor, low, {&bases[0], &bases[1], &bases[2], &bases[3]}, Op::kNone, out,
                       scratch);
    CHECK(nsvd(executor, MemorySource(out.data(), shape), {ranks, 20, 1e-4}).errors.back() < 1e-6);
    CHECK(nsvd(executor, source, {shape, 20, 1e-4}).errors.back() < 1e-6);

    // Modes left alone; one mode only is solved at once.
    const Tucker partial = nsvd(executor, source, {{0, 2, 0, 3}, 30, 1e-6});
    CHECK(partial.core.shape() == Shape({6, 2, 8, 3}) && partial.bases[0].size() == 0);
    const double rest = dense::distance(reconstruct(partial.core, partial.bases), array);
    CHECK_NEAR(rest * rest / array.squared_norm(), partial.errors.back(), 1e-5);
    const Tucker single = nsvd(executor, source, {{0, 0, 4, 0}, 30, 1e-6});
    const VectorD values = dense::svd(dense::unfold(array, 2)).s;
    CHECK_NEAR(single.errors.back(), values.tail(4).squaredNorm() / array.squared_norm(), 1e-5);
    CHECK(nsvd(executor, source, {{0, 0, 0, 0}, 30, 1e-6}).core.shape() == shape);

    check_resumes(executor, tensor, ranks, 7);
    check_resumes(executor, tensor, {0, 2, 0, 3}, 8);  // in the end one for the core

    // No iteration: the truncated HOSVD.
    const Tucker hosvd = nsvd(executor, source, {ranks, 0, 0});
    CHECK(hosvd.iterations == 0 && hosvd.errors.size() == 1);
    dense::Array truncated = array;
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        const MatrixD left = dense::svd(dense::unfold(truncated, n)).u.leftCols(ranks[n]);
        truncated = dense::mode_product(truncated, n, left.transpose());
    }
    CHECK_NEAR(hosvd.errors[0], 1 - truncated.squared_norm() / array.squared_norm(), 1e-6);
    CHECK(hosvd.errors[0] > tucker.errors.back());

    // Nothing but zeros, and modes of one row.
    Tensor zero(shape);
    zero.fill(0);
    const Tucker none = nsvd(executor, MemorySource(zero.data(), shape), {ranks, 20, 1e-4});
    CHECK(none.errors.back() == 0 && orthonormality_error(none.bases[2]) < 1e-6);
    const Tensor thin = random_tensor({1, 9, 1, 4}, 2);
    CHECK(nsvd(executor, MemorySource(thin.data(), thin.shape()), {{1, 4, 1, 4}, 20, 1e-4})
              .errors.back() < 1e-6);
    std::puts("ok");
}
