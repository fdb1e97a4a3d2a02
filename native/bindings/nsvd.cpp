#include "nacre/nsvd.hpp"

#include <algorithm>

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

py::dict to_python(const Tucker& tucker, double passes) {
    py::list basis;
    std::vector<py::ssize_t> core_shape{1};
    for (const MatrixF& u : tucker.bases) {
        basis.append(to_numpy(u.data(), {1, u.rows(), 1, u.cols()}));
        core_shape.push_back(u.cols());
    }
    py::dict result;
    result["core"] = to_numpy(tucker.core.data(), core_shape);
    result["basis"] = basis;
    result["errors"] = tucker.errors;
    result["squared_norm"] = tucker.squared_norm;
    result["iterations"] = tucker.iterations;
    result["passes"] = passes;
    return result;
}

Tucker from_python(const py::dict& start, const Shape& shape, const std::vector<Index>& ranks) {
    for (const char* key : {"core", "basis", "errors", "squared_norm", "iterations", "passes"}) {
        require(start.contains(key), "start: expected a model with ", key);
    }
    Tucker tucker;
    const auto core = array_argument<float>(start["core"], "start core", 5);
    const py::list basis(start["basis"]);
    require(core.shape(0) == 1 && std::equal(ranks.begin(), ranks.end(), core.shape() + 1) &&
                basis.size() == ranks.size(),
            "start: expected a model of the same shape and ranks");
    tucker.core = Tensor(Shape(core.shape() + 1, core.shape() + 5));
    std::copy_n(core.data(), core.size(), tucker.core.data());
    for (std::size_t n = 0; n < ranks.size(); ++n) {
        const auto u = array_argument<float>(basis[n], "start basis", 4);
        require(u.size() == shape[n] * ranks[n] && u.shape(3) == ranks[n],
                "start: expected a model of the same shape and ranks");
        tucker.bases.push_back(Eigen::Map<const MatrixF>(u.data(), shape[n], ranks[n]));
    }
    tucker.errors = start["errors"].cast<std::vector<double>>();
    tucker.squared_norm = start["squared_norm"].cast<double>();
    tucker.iterations = start["iterations"].cast<int>();
    require(tucker.errors.size() == at(std::max(tucker.iterations, 1)),
            "start: expected an error for each iteration");
    return tucker;
}

py::dict fit_nsvd(const py::array& samples, const std::vector<Index>& ranks, int iterations,
                  double tolerance, int threads, std::size_t memory, const std::string& scratch,
                  const std::string& domain, const py::object& start, const py::object& checkpoint,
                  const py::object& progress) {
    const BtfSource source = btf_source(samples, memory > 0, domain);
    const Shape& shape = source.shape();
    require(ranks.size() == shape.size(), "ranks: expected ", shape.size(), " numbers, got ",
            ranks.size());
    for (std::size_t n = 0; n < shape.size(); ++n) {
        require(ranks[n] >= 1 && ranks[n] <= shape[n], "ranks: expected 1 to ", shape[n],
                " for mode ", n, ", got ", ranks[n]);
    }
    require(iterations >= 0, "iterations: expected 0 or more, got ", iterations);
    require(tolerance >= 0, "tolerance: expected 0 or more, got ", tolerance);
    NsvdOptions options{ranks, iterations, tolerance};
    Tucker first;
    double passes = 0;  // of the fit that is taken up again
    if (!start.is_none()) {
        const py::dict model(start);
        first = from_python(model, shape, ranks);
        passes = model["passes"].cast<double>();
        options.start = &first;
    }
    if (!checkpoint.is_none()) {
        options.checkpoint = [&](const Tucker& state) {
            const py::gil_scoped_acquire acquire;
            checkpoint(to_python(state, passes + source.passes()));
        };
    }
    Executor executor(threads, progress_callback(progress));
    Tucker tucker;
    {
        const py::gil_scoped_release release;
        options.workspace = Workspace(memory, scratch);
        tucker = nsvd(executor, source, options);
    }
    return to_python(tucker, passes + source.passes());
}

}  // namespace

void register_nsvd(py::module_& module) {
    module.def("fit_nsvd", &fit_nsvd, py::arg("samples"), py::arg("ranks"), py::kw_only(),
               py::arg("iterations") = 20, py::arg("tolerance") = 1e-4, py::arg("threads") = 0,
               py::arg("memory") = 0, py::arg("scratch") = "", py::arg("domain") = "linear",
               py::arg("start") = py::none(), py::arg("checkpoint") = py::none(),
               py::arg("progress") = py::none(),
               R"(N-SVD of samples (light, view, y, x, channel).

ranks: of (light rows, view, y, x), where light row channels * light + channel is one colour of one
light. iterations, tolerance: alternating least squares stops when the error falls by less than this
part of itself; 0 iterations give the truncated HOSVD. threads: 0 for all. memory: bytes that the
process may use, what it has in use already included (0: no bound); what exceeds it is in files in
the folder scratch (empty: the system's), which nobody sees and which go with the process. domain:
"linear", or "log" to fit log(Y + 0.01), U / (Y + 0.01) and V / (Y + 0.01) of red, green and blue.
checkpoint(model) is called after each iteration; start takes such a model, and the fit goes on from
there to the same bits. progress(fraction, message) returns False to stop.

Returns core (1, RL, RV, RY, RX), basis (of each mode, (1, I, 1, R), orthonormal columns), errors
(||A - approximation||^2 / ||A||^2 after each iteration, or of the HOSVD), squared_norm (||A||^2),
iterations and passes (how often the samples were read).
De Lathauwer et al. 2000. Raises ValueError (one line that names the argument), RuntimeError where
there is no room for the files, and Cancelled.)");
}

}  // namespace nacre::python
