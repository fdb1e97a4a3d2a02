// What the bindings share: arrays in and out, progress, and one register function a feature.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <span>
#include <string>
#include <vector>

#include "nacre/cluster_search.hpp"
#include "nacre/executor.hpp"
#include "nacre/source.hpp"

namespace nacre::python {

namespace py = pybind11;

void register_nsvd(py::module_& module);
void register_clustered(py::module_& module);
void register_search(py::module_& module);
void register_evaluator(py::module_& module);
void register_table_evaluator(py::module_& module);
void register_ensemble(py::module_& module);

// Samples (light, view, y, x, channel), C-contiguous half or float, used where they lie. `bounded`:
// memory is; pages of a read-only numpy.memmap are dropped behind the reader.
BtfSource btf_source(const py::array& samples, bool bounded = false,
                     const std::string& domain = "linear");

// Whether the array lies in a numpy.memmap that was opened read-only: then its pages may be
// dropped.
bool in_read_only_map(const py::array& array);

// auto, kcta, greedy or optimal.
SearchMethod search_method(const std::string& name);

// Calls `progress(fraction, message) -> bool` (or None) with the GIL held, and lets a Ctrl-C of the
// main thread through.
Executor::Progress progress_callback(const py::object& progress);

// An array of this type and of `dimensions` dimensions, converted where it is not; `name` is for
// the error.
template <class T>
py::array_t<T, py::array::c_style> array_argument(const py::object& value, const char* name,
                                                  py::ssize_t dimensions) {
    auto array = py::array_t<T, py::array::c_style | py::array::forcecast>::ensure(value);
    if (!array) {
        PyErr_Clear();
        throw py::value_error(std::string(name) + ": expected an array of numbers");
    }
    if (array.ndim() != dimensions) {
        throw py::value_error(std::string(name) + ": expected " + std::to_string(dimensions) +
                              " dimensions, got " + std::to_string(array.ndim()));
    }
    return array;
}

// A numpy array of this shape with a copy of `values`.
template <class T>
py::array_t<T> to_numpy(const T* values, std::vector<py::ssize_t> shape) {
    py::array_t<T> array(std::move(shape));
    std::copy_n(values, array.size(), array.mutable_data());
    return array;
}

}  // namespace nacre::python
