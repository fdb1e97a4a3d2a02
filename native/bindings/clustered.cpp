#include "nacre/clustered.hpp"

#include <algorithm>
#include <map>

#include "bindings.hpp"
#include "nacre/core_gram.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

SearchMethod search_method(const std::string& name) {
    if (name == "auto") return SearchMethod::kAuto;
    if (name == "kcta") return SearchMethod::kKcta;
    if (name == "greedy") return SearchMethod::kGreedy;
    require(name == "optimal", "search: expected auto, kcta, greedy or optimal, got ", name);
    return SearchMethod::kOptimal;
}

namespace {

using ByMode = std::map<Index, Index>;

ClusteredOptions read_options(const std::vector<Index>& ranks, const ByMode& clusters,
                              const ByMode& mixtures, const std::vector<Index>& global_modes,
                              const py::dict& directions, const std::string& search, int iterations,
                              double tolerance, std::uint64_t seed) {
    ClusteredOptions options;
    options.ranks = ranks;
    for (const auto& [mode, count] : clusters) {
        ClusteredMode clustered;
        clustered.mode = mode;
        clustered.clusters = count;
        const auto mixture = mixtures.find(mode);
        if (mixture != mixtures.end()) clustered.mixtures = mixture->second;
        const py::int_ key(mode);
        require(directions.contains(key), "directions: expected those of mode ", mode);
        const auto points = array_argument<double>(directions[key], "directions", 2);
        clustered.parameters =
            Eigen::Map<const MatrixD>(points.data(), points.shape(0), points.shape(1));
        options.clustered.push_back(std::move(clustered));
    }
    for (const auto& entry : mixtures) {
        require(clusters.contains(entry.first), "mixtures: mode ", entry.first, " has no clusters");
    }
    options.global_modes = global_modes;
    options.search = search_method(search);
    options.iterations = iterations;
    options.tolerance = tolerance;
    options.seed = seed;
    return options;
}

// A model of no cores is what a fit knows before its first clusters: global bases alone.
py::dict to_python(const ClusteredTucker& model, const ClusteredOptions& options, double passes) {
    const py::ssize_t count = static_cast<py::ssize_t>(model.cores.size());
    std::vector<py::ssize_t> core_shape{count};
    for (Index rank : options.ranks) core_shape.push_back(rank);
    py::array_t<float> core(core_shape);
    for (py::ssize_t c = 0; c < count; ++c) {
        const Tensor& z = model.cores[at(c)];
        std::copy_n(z.data(), z.size(), core.mutable_data() + c * z.size());
    }
    py::list basis;
    for (std::size_t n = 0; n < model.bases.size(); ++n) {
        const std::vector<MatrixF>& bases = model.bases[n];
        const py::ssize_t owners = static_cast<py::ssize_t>(bases.size()), rank = options.ranks[n];
        const py::ssize_t rows = owners ? bases[0].rows() : 0;
        const py::ssize_t mixtures = owners ? bases[0].cols() / rank : 1;
        py::array_t<float> array({owners, rows, mixtures, rank});
        for (py::ssize_t o = 0; o < owners; ++o) {
            const MatrixF& u = bases[at(o)];
            std::copy_n(u.data(), u.size(), array.mutable_data() + o * u.size());
        }
        basis.append(array);
    }
    py::dict members;
    for (std::size_t k = 0; k < model.members.size(); ++k) {
        const Index mode = options.clustered[k].mode;
        const py::ssize_t items = options.clustered[k].parameters.rows();
        members[py::int_(mode)] =
            to_numpy(model.members[k].data(),
                     {items, static_cast<py::ssize_t>(model.members[k].size()) / items});
    }
    py::dict result;
    result["core"] = core;
    result["basis"] = basis;
    result["members"] = members;
    result["errors"] = model.errors;
    result["squared_norm"] = model.squared_norm;
    result["iterations"] = model.errors.empty() ? 0 : model.errors.size() - 1;
    result["passes"] = passes;
    return result;
}

ClusteredTucker from_python(const py::dict& start, const ClusteredOptions& options) {
    for (const char* key : {"core", "basis", "members", "errors", "squared_norm"}) {
        require(start.contains(key), "start: expected a model with ", key);
    }
    ClusteredTucker model;
    const std::size_t order = options.ranks.size();
    const auto core =
        array_argument<float>(start["core"], "start core", static_cast<py::ssize_t>(order) + 1);
    const Shape shape(core.shape() + 1, core.shape() + core.ndim());
    for (py::ssize_t c = 0; c < core.shape(0); ++c) {
        Tensor z(shape);
        std::copy_n(core.data() + c * z.size(), z.size(), z.data());
        model.cores.push_back(std::move(z));
    }
    const py::list basis(start["basis"]);
    require(basis.size() == order, "start basis: expected ", order, " arrays, got ", basis.size());
    for (std::size_t n = 0; n < order; ++n) {
        const auto array = array_argument<float>(basis[n], "start basis", 4);
        const Index rows = array.shape(1), columns = array.shape(2) * array.shape(3);
        std::vector<MatrixF> bases;
        for (py::ssize_t o = 0; o < array.shape(0); ++o) {
            bases.push_back(
                Eigen::Map<const MatrixF>(array.data() + o * rows * columns, rows, columns));
        }
        model.bases.push_back(std::move(bases));
    }
    const py::dict members(start["members"]);
    for (const ClusteredMode& mode : options.clustered) {
        const py::int_ key(mode.mode);
        if (!members.contains(key)) continue;
        const auto array = array_argument<ClusterId>(members[key], "start members", 2);
        model.members.emplace_back(array.data(), array.data() + array.size());
    }
    model.errors = start["errors"].cast<std::vector<double>>();
    model.squared_norm = start["squared_norm"].cast<double>();
    return model;
}

py::dict fit(const py::array& samples, const std::vector<Index>& ranks, const ByMode& clusters,
             const ByMode& mixtures, const std::vector<Index>& global_modes,
             const py::dict& directions, const std::string& search, int iterations,
             double tolerance, std::uint64_t seed, int threads, std::size_t memory,
             const std::string& scratch, const std::string& domain, const py::object& start,
             const py::object& checkpoint, const py::object& progress) {
    const BtfSource source = btf_source(samples, memory > 0, domain);
    const ClusteredOptions options = read_options(ranks, clusters, mixtures, global_modes,
                                                  directions, search, iterations, tolerance, seed);
    ClusteredTucker first;
    double passes = 0;  // of the fit that is taken up again
    if (!start.is_none()) {
        const py::dict model(start);
        first = from_python(model, options);
        if (model.contains("passes")) passes = model["passes"].cast<double>();
    }
    ClusteredCheckpoint report;
    if (!checkpoint.is_none()) {
        report = [&](const ClusteredTucker& state) {
            const py::gil_scoped_acquire acquire;
            checkpoint(to_python(state, options, passes + source.passes()));
        };
    }
    Executor executor(threads, progress_callback(progress));
    ClusteredTucker model;
    {
        const py::gil_scoped_release release;
        const Workspace workspace(memory, scratch);
        model = fit_clustered(executor, workspace, source, options,
                              start.is_none() ? nullptr : &first, report);
    }
    return to_python(model, options, passes + source.passes());
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

void register_clustered(py::module_& module) {
    module.def("fit_clustered", &fit, py::arg("samples"), py::arg("ranks"), py::kw_only(),
               py::arg("clusters"), py::arg("mixtures") = ByMode{},
               py::arg("global_modes") = std::vector<Index>{}, py::arg("directions"),
               py::arg("search") = "auto", py::arg("iterations") = 50, py::arg("tolerance") = 5e-4,
               py::arg("seed") = 0, py::arg("threads") = 0, py::arg("memory") = 0,
               py::arg("scratch") = "", py::arg("domain") = "linear", py::arg("start") = py::none(),
               py::arg("checkpoint") = py::none(), py::arg("progress") = py::none(),
               R"(CTA, K-CTA or MK-CTA of samples (light, view, y, x, channel).

ranks: of (light rows, view, y, x), where light row channels * light + channel is one colour of one
light; the colours of a light share its clusters. clusters, mixtures: {mode: C} and {mode: K} of the
clustered modes; one clustered mode is K-CTA (CTA for K = 1), several are MK-CTA. global_modes: modes
whose basis all clusters share. directions: {mode: (items, any)}, where the lights, views ... of each
clustered mode lie: near ones start in one cluster. search: "kcta" (Tsai and Shih 2012, Theorems 1 and
3), "greedy" (orthogonal least squares; Tsai 2015, Algorithm 3), "optimal" (Algorithm 2) or "auto":
kcta for one clustered mode, else optimal for K < 3 and greedy beyond. iterations, tolerance: stops
when neither the sum of core norms nor the error changes by more than this part, or when the error
would rise. The same seed gives the same bits for any threads (0: all). memory: bytes that the process
may have in anonymous memory (0: any), beyond which large tensors go to files in the folder scratch.
domain: as of fit_nsvd.
start: a model to begin with, as returned or as given to checkpoint(model), which is called after each
iteration that another follows; with the latter the fit ends as if it had not been interrupted.
progress(fraction, message) returns False to stop.

Returns core (product of all C, RL, RV, RY, RX; clusters in mode order, last fastest), basis (of each
mode (owners, I, K, R): owners are the combinations of the other clustered modes' clusters, one for a
global basis; K is 1 unless the mode is clustered), members ({mode: (items, K) uint32}, ascending in a
row), errors (||A - approximation||^2 / ||A||^2 of the first guess and after each iteration),
squared_norm (||A||^2), iterations and passes (how often the samples were read).
Raises ValueError (one line that names the argument) and Cancelled.)");
    module.def(
        "core_gram", &core_gram_of, py::arg("core"), py::arg("basis"), py::kw_only(),
        py::arg("clustered") = 1, py::arg("threads") = 0,
        R"(Gram matrix of the clusters of a model of one clustered mode, as fit_clustered returns it,
for search_clusters.

core (C, R0, ..., RN), basis: list of (1 or C, I, 1, R) arrays (that of the clustered mode is not
looked at). Returns (C, C, R, R): gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T, Eqs. 14 and 17.)");
}

}  // namespace nacre::python
