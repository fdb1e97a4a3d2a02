#include "nacre/nsvd.hpp"

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

py::dict fit_nsvd(const py::array& samples, const std::vector<Index>& ranks, int iterations,
                  double tolerance, int threads, const py::object& progress) {
    const BtfSource source = btf_source(samples);
    const Shape& shape = source.shape();
    require(ranks.size() == shape.size(), "ranks: expected ", shape.size(), " numbers, got ",
            ranks.size());
    for (std::size_t n = 0; n < shape.size(); ++n) {
        require(ranks[n] >= 1 && ranks[n] <= shape[n], "ranks: expected 1 to ", shape[n],
                " for mode ", n, ", got ", ranks[n]);
    }
    require(iterations >= 1, "iterations: expected 1 or more, got ", iterations);
    require(tolerance >= 0, "tolerance: expected 0 or more, got ", tolerance);

    Executor executor(threads, progress_callback(progress));
    Tucker tucker;
    {
        const py::gil_scoped_release release;
        tucker = nsvd(executor, source, {ranks, iterations, tolerance});
    }
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
    result["iterations"] = tucker.errors.size();
    return result;
}

}  // namespace

void register_nsvd(py::module_& module) {
    module.def("fit_nsvd", &fit_nsvd, py::arg("samples"), py::arg("ranks"), py::kw_only(),
               py::arg("iterations") = 20, py::arg("tolerance") = 1e-4, py::arg("threads") = 0,
               py::arg("progress") = py::none(), R"(N-SVD of samples (light, view, y, x, channel).

ranks: of (light rows, view, y, x), where light row channels * light + channel is one colour of one
light. iterations, tolerance: alternating least squares stops when the error falls by less than this
part of itself. threads: 0 for all. progress(fraction, message) returns False to stop.

Returns core (1, RL, RV, RY, RX), basis (of each mode, (1, I, 1, R), orthonormal columns), errors
(||A - approximation||^2 / ||A||^2 after each iteration), squared_norm (||A||^2) and iterations.
De Lathauwer et al. 2000. Raises ValueError (one line that names the argument) and Cancelled.)");
}

}  // namespace nacre::python
