#include "nacre/kcta.hpp"

#include <algorithm>

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

py::dict fit_kcta(const py::array& samples, const std::vector<Index>& ranks, Index clustered,
                  Index clusters, Index mixtures, const std::vector<Index>& global_modes,
                  const py::object& directions, int iterations, double tolerance,
                  std::uint64_t seed, int threads, const py::object& progress) {
    const BtfSource source = btf_source(samples);
    require(clustered != 0 || source.channels() == 1,
            "clustered: expected a mode from 1 to 3, got 0: the light mode has a row for each "
            "colour, and these must share their clusters");
    KctaOptions options;
    options.ranks = ranks;
    options.clustered = clustered;
    options.clusters = clusters;
    options.mixtures = mixtures;
    options.global_modes = global_modes;
    options.iterations = iterations;
    options.tolerance = tolerance;
    options.seed = seed;
    const auto points = array_argument<double>(directions, "directions", 2);
    options.parameters = Eigen::Map<const MatrixD>(points.data(), points.shape(0), points.shape(1));

    Executor executor(threads, progress_callback(progress));
    Kcta model;
    {
        const py::gil_scoped_release release;
        model = kcta(executor, source, options);
    }

    const py::ssize_t count = clusters;
    std::vector<py::ssize_t> core_shape{count};
    for (Index extent : model.cores[0].shape()) core_shape.push_back(extent);
    py::array_t<float> core(core_shape);
    for (py::ssize_t c = 0; c < count; ++c) {
        const Tensor& z = model.cores[at(c)];
        std::copy_n(z.data(), z.size(), core.mutable_data() + c * z.size());
    }
    py::list basis;
    const py::ssize_t items = source.shape()[at(clustered)];
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        if (static_cast<Index>(n) == clustered) {
            basis.append(to_numpy(model.coefficients.data(), {1, items, mixtures, ranks[n]}));
            continue;
        }
        const std::vector<MatrixF>& bases = model.bases[n];
        const py::ssize_t owners = static_cast<py::ssize_t>(bases.size());
        py::array_t<float> array(
            {owners, py::ssize_t{bases[0].rows()}, py::ssize_t{1}, py::ssize_t{bases[0].cols()}});
        for (py::ssize_t o = 0; o < owners; ++o) {
            const MatrixF& u = bases[at(o)];
            std::copy_n(u.data(), u.size(), array.mutable_data() + o * u.size());
        }
        basis.append(array);
    }
    py::dict result;
    result["core"] = core;
    result["basis"] = basis;
    result["members"] = to_numpy(model.members.data(), {items, mixtures});
    result["errors"] = model.errors;
    result["squared_norm"] = model.squared_norm;
    result["iterations"] = model.iterations;
    return result;
}

py::array_t<double> core_gram_of(const py::object& core, const py::list& basis, Index clustered,
                                 int threads) {
    auto values = py::array_t<float, py::array::c_style | py::array::forcecast>::ensure(core);
    if (!values || values.ndim() < 2) {
        PyErr_Clear();
        throw py::value_error("core: expected an array (clusters, rank of each mode)");
    }
    const Index order = values.ndim() - 1, count = values.shape(0);
    require(clustered >= 0 && clustered < order, "clustered: expected a mode from 0 to ", order - 1,
            ", got ", clustered);
    require(static_cast<Index>(basis.size()) == order, "basis: expected ", order, " arrays, got ",
            basis.size());
    const Shape shape(values.shape() + 1, values.shape() + values.ndim());
    std::vector<Tensor> cores;
    for (Index c = 0; c < count; ++c) {
        cores.emplace_back(shape);
        std::copy_n(values.data() + c * product(shape), product(shape), cores.back().data());
    }
    std::vector<std::vector<MatrixF>> bases(at(order));
    for (Index n = 0; n < order; ++n) {
        if (n == clustered) continue;
        const std::size_t mode = at(n);
        const auto array = array_argument<float>(basis[mode], "basis", 4);
        require((array.shape(0) == 1 || array.shape(0) == count) && array.shape(2) == 1 &&
                    array.shape(3) == shape[mode],
                "basis: expected (1 or ", count, ", rows, 1, ", shape[mode], ") for mode ", n,
                ", got (", array.shape(0), ", ", array.shape(1), ", ", array.shape(2), ", ",
                array.shape(3), ")");
        const Index size = array.shape(1) * array.shape(3);
        for (py::ssize_t o = 0; o < array.shape(0); ++o) {
            bases[mode].push_back(
                Eigen::Map<const MatrixF>(array.data() + o * size, array.shape(1), array.shape(3)));
        }
    }
    MatrixD gram;
    {
        const py::gil_scoped_release release;
        Executor executor(threads);
        gram = core_gram(executor, cores, bases, clustered);
    }
    const Index rank = shape[at(clustered)];
    py::array_t<double> result({count, count, rank, rank});
    auto out = result.mutable_unchecked<4>();
    for (Index j = 0; j < count; ++j) {
        for (Index c = 0; c < count; ++c) {
            for (Index r = 0; r < rank; ++r) {
                for (Index s = 0; s < rank; ++s) out(j, c, r, s) = gram(j * rank + r, c * rank + s);
            }
        }
    }
    return result;
}

}  // namespace

void register_kcta(py::module_& module) {
    module.def("fit_kcta", &fit_kcta, py::arg("samples"), py::arg("ranks"), py::kw_only(),
               py::arg("clustered") = 1, py::arg("clusters"), py::arg("mixtures"),
               py::arg("global_modes") = std::vector<Index>{0}, py::arg("directions"),
               py::arg("iterations") = 50, py::arg("tolerance") = 5e-4, py::arg("seed") = 0,
               py::arg("threads") = 0, py::arg("progress") = py::none(),
               R"(K-CTA of samples (light, view, y, x, channel); CTA if mixtures is 1.

ranks: of (light rows, view, y, x), where light row channels * light + channel is one colour of one
light. clustered: the clustered mode. clusters, mixtures: C and K. global_modes: modes whose basis
all clusters share. directions: (I, any) coordinates of the clustered mode's rows; near ones start
in one cluster. iterations, tolerance: stops when neither the sum of core norms nor the error changes
by more than this part, or when the error would rise. The same seed gives the same bits for any threads (0: all). progress(fraction, message)
returns False to stop.

Returns core (C, RL, RV, RY, RX), basis (of each mode; (1, I, K, R) for the clustered one, (1, I, 1,
R) for a global one, else (C, I, 1, R)), members (I, K) uint32, ascending in a row, errors
(||A - approximation||^2 / ||A||^2 of the first guess and after each iteration), squared_norm
(||A||^2) and iterations.
Tsai and Shih 2012, Algorithm 1. Raises ValueError (one line that names the argument) and
Cancelled.)");
    module.def(
        "core_gram", &core_gram_of, py::arg("core"), py::arg("basis"), py::kw_only(),
        py::arg("clustered") = 1, py::arg("threads") = 0,
        R"(Gram matrix of the clusters of a model as fit_kcta returns it, for search_clusters.

core (C, R0, ..., RN), basis: list of (1 or C, I, 1, R) arrays (that of the clustered mode is not
looked at). Returns (C, C, R, R): gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T, Eqs. 14 and 17.)");
}

}  // namespace nacre::python
