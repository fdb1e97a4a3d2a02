#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

// Itself or as a view of one. Pages of a copy-on-write map, or of memory, would be lost.
bool in_read_only_map(const py::array& array) {
    const py::object memmap = py::module_::import("numpy").attr("memmap");
    const auto* first = static_cast<const char*>(array.data());
    for (py::object owner = array; py::isinstance<py::array>(owner); owner = owner.attr("base")) {
        if (!py::isinstance(owner, memmap) || owner.attr("_mmap").is_none()) continue;
        if (!py::str("r").equal(owner.attr("mode"))) return false;
        const auto whole = py::reinterpret_borrow<py::array>(owner);
        const auto* begin = static_cast<const char*>(whole.data());
        if (first >= begin && first + array.nbytes() <= begin + whole.nbytes()) return true;
    }
    return false;
}

BtfSource btf_source(const py::array& samples, bool bounded, const std::string& domain) {
    if (samples.ndim() != 5) {
        throw py::value_error("samples: expected 5 axes (light, view, y, x, channel), got " +
                              std::to_string(samples.ndim()));
    }
    const py::dtype type = samples.dtype();
    const bool native = type.byteorder() == '=' || type.byteorder() == '<';
    if (type.kind() != 'f' || (type.itemsize() != 2 && type.itemsize() != 4) || !native) {
        throw py::value_error("samples: expected float16 or float32, got " +
                              py::str(type).cast<std::string>());
    }
    if (!(samples.flags() & py::array::c_style)) {
        throw py::value_error("samples: expected a C-contiguous array");
    }
    const SampleType sample = type.itemsize() == 2 ? SampleType::kHalf : SampleType::kFloat;
    return BtfSource(
        samples.data(), sample,
        {samples.shape(0), samples.shape(1), samples.shape(2), samples.shape(3), samples.shape(4)},
        bounded && in_read_only_map(samples), colour_domain(domain));
}

Executor::Progress progress_callback(const py::object& progress) {
    return [progress](double fraction, const std::string& message) {
        py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (progress.is_none()) return true;
        const py::object answer = progress(fraction, message);
        return answer.is_none() || answer.cast<bool>();
    };
}

}  // namespace nacre::python

PYBIND11_MODULE(_native, module) {
    pybind11::register_exception<nacre::Cancelled>(module, "Cancelled").doc() =
        "The progress callback asked for a stop.";
    module.attr("__version__") = NACRE_VERSION;
    nacre::python::register_nsvd(module);
    nacre::python::register_clustered(module);
    nacre::python::register_search(module);
    nacre::python::register_evaluator(module);
    nacre::python::register_table_evaluator(module);
    nacre::python::register_ensemble(module);
}
