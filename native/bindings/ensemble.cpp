#include "nacre/ensemble.hpp"

#include <algorithm>

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

Patches patches_of(const py::array& patches) {
    if (patches.ndim() < 2) {
        throw py::value_error("patches: expected axes (patch, mode 1, ...), got " +
                              std::to_string(patches.ndim()));
    }
    const py::dtype type = patches.dtype();
    const bool native = type.byteorder() == '=' || type.byteorder() == '<';
    if (type.kind() != 'f' || (type.itemsize() != 2 && type.itemsize() != 4) || !native) {
        throw py::value_error("patches: expected float16 or float32, got " +
                              py::str(type).cast<std::string>());
    }
    if (!(patches.flags() & py::array::c_style)) {
        throw py::value_error("patches: expected a C-contiguous array");
    }
    return Patches(patches.data(), type.itemsize() == 2 ? SampleType::kHalf : SampleType::kFloat,
                   patches.shape(0), Shape(patches.shape() + 1, patches.shape() + patches.ndim()),
                   in_read_only_map(patches));
}

py::list to_python(const Ensemble& ensemble) {
    py::list modes;
    for (std::size_t n = 0; n < ensemble[0].size(); ++n) {
        const Index size = ensemble[0][n].rows();
        py::array_t<float> matrices({static_cast<Index>(ensemble.size()), size, size});
        float* to = matrices.mutable_data();
        for (const Dictionary& dictionary : ensemble) {
            to = std::copy_n(dictionary[n].data(), size * size, to);
        }
        modes.append(matrices);
    }
    return modes;
}

Ensemble from_python(const py::object& dictionaries, const Shape& shape) {
    const py::list modes(dictionaries);
    require(modes.size() == shape.size(), "dictionaries: expected matrices of ", shape.size(),
            " modes, got ", modes.size());
    Ensemble ensemble;
    for (std::size_t n = 0; n < shape.size(); ++n) {
        const auto matrices = array_argument<float>(modes[n], "dictionaries", 3);
        if (n == 0) ensemble.resize(at(matrices.shape(0)));
        require(matrices.shape(1) == shape[n] && matrices.shape(2) == shape[n] &&
                    !ensemble.empty() && at(matrices.shape(0)) == ensemble.size(),
                "dictionaries: expected (", ensemble.size(), ", ", shape[n], ", ", shape[n],
                ") for mode ", n, ", got (", matrices.shape(0), ", ", matrices.shape(1), ", ",
                matrices.shape(2), ")");
        for (std::size_t k = 0; k < ensemble.size(); ++k) {
            ensemble[k].push_back(Eigen::Map<const MatrixF>(
                matrices.data() + static_cast<Index>(k) * shape[n] * shape[n], shape[n], shape[n]));
        }
    }
    require(orthonormality_error(ensemble) < 1e-3,
            "dictionaries: expected orthonormal matrices, got some that are not");
    return ensemble;
}

py::dict to_python(const Training& training) {
    py::dict result;
    result["dictionaries"] = to_python(training.ensemble);
    result["members"] =
        to_numpy(training.members.data(), {static_cast<py::ssize_t>(training.members.size())});
    result["errors"] = training.errors;
    result["orthonormality"] = training.orthonormality;
    result["reseeded"] = training.reseeded;
    result["squared_norm"] = training.squared_norm;
    result["sweeps"] = training.sweeps;
    return result;
}

Training training_of(const py::dict& start, const Patches& patches,
                     const TrainingOptions& options) {
    for (const char* key :
         {"dictionaries", "members", "errors", "orthonormality", "reseeded", "sweeps"}) {
        require(start.contains(key), "start: expected a state with ", key);
    }
    Training training;
    training.ensemble = from_python(start["dictionaries"], patches.shape());
    const auto members = array_argument<std::uint32_t>(start["members"], "start members", 1);
    training.members.assign(members.data(), members.data() + members.size());
    training.errors = start["errors"].cast<std::vector<double>>();
    training.orthonormality = start["orthonormality"].cast<std::vector<double>>();
    training.reseeded = start["reseeded"].cast<std::vector<Index>>();
    training.sweeps = start["sweeps"].cast<int>();
    const std::size_t sweeps = training.errors.size();
    require(static_cast<Index>(training.ensemble.size()) == options.dictionaries &&
                static_cast<Index>(training.members.size()) == patches.count() &&
                std::all_of(training.members.begin(), training.members.end(),
                            [&](std::uint32_t k) { return k < training.ensemble.size(); }),
            "start: expected a state of as many patches and dictionaries");
    require(
        training.sweeps >= 1 && sweeps == at(training.sweeps) && training.reseeded.size() == sweeps,
        "start: expected an error for each sweep");
    return training;
}

py::dict fit_ensemble(const py::array& patches, Index dictionaries, Index sparsity, int sweeps,
                      double tolerance, int reassign, std::uint64_t seed, int threads,
                      const py::object& start, const py::object& checkpoint,
                      const py::object& progress) {
    const Patches source = patches_of(patches);
    const TrainingOptions options{dictionaries, sparsity, sweeps, tolerance, reassign, seed};
    Training first;
    if (!start.is_none()) first = training_of(py::dict(start), source, options);
    TrainingCheckpoint report;
    if (!checkpoint.is_none()) {
        report = [&](const Training& state) {
            const py::gil_scoped_acquire acquire;
            checkpoint(to_python(state));
        };
    }
    Executor executor(threads, progress_callback(progress));
    Training training;
    {
        const py::gil_scoped_release release;
        training = train(executor, source, options, start.is_none() ? nullptr : &first, report);
    }
    return to_python(training);
}

py::dict code_patches(const py::array& patches, const py::object& dictionaries, Index sparsity,
                      double error, int threads, const py::object& progress) {
    const Patches source = patches_of(patches);
    const Ensemble ensemble = from_python(dictionaries, source.shape());
    Executor executor(threads, progress_callback(progress));
    SparseCode found;
    {
        const py::gil_scoped_release release;
        found = code(executor, source, ensemble, sparsity, error);
    }
    const py::ssize_t count = source.count();
    py::dict result;
    result["positions"] = to_numpy(found.positions.data(), {count, sparsity});
    result["values"] = to_numpy(found.values.data(), {count, sparsity});
    result["counts"] = to_numpy(found.counts.data(), {count});
    result["members"] = to_numpy(found.members.data(), {count});
    result["errors"] = to_numpy(found.errors.data(), {count});
    return result;
}

}  // namespace

void register_ensemble(py::module_& module) {
    module.def(
        "fit_ensemble", &fit_ensemble, py::arg("patches"), py::kw_only(), py::arg("dictionaries"),
        py::arg("sparsity"), py::arg("sweeps") = 30, py::arg("tolerance") = 1e-3,
        py::arg("reassign") = 1, py::arg("seed") = 0, py::arg("threads") = 0,
        py::arg("start") = py::none(), py::arg("checkpoint") = py::none(),
        py::arg("progress") = py::none(),
        R"(An ensemble of orthonormal dictionaries for patches (n, I1, ..., IN), float16 or float32.

dictionaries: K. sparsity: coefficients of each patch. sweeps, tolerance: stops when the objective
falls by less than this part of itself. reassign: choose each patch's dictionary anew in every so many
sweeps. checkpoint(state) is called after each sweep; start takes such a state, and the training goes
on from there to the same bits. progress(fraction, message) returns False to stop.

Returns dictionaries (of each mode (K, I, I), atoms are columns), members (n,), errors (the objective
over the patches' squared norm at the begin of each sweep, and at the end), orthonormality (largest
entry of |U^T U - I| after each sweep), reseeded (dictionaries without patches in each sweep),
squared_norm and sweeps.
Kavoosighafi et al. 2023, Eqs. 2a to 2d. Raises ValueError (one line that names the argument) and
Cancelled.)");
    module.def("code_patches", &code_patches, py::arg("patches"), py::arg("dictionaries"),
               py::arg("sparsity"), py::kw_only(), py::arg("error") = 0.0, py::arg("threads") = 0,
               py::arg("progress") = py::none(),
               R"(Sparse codes of patches (n, I1, ..., IN) in an ensemble: of each mode (K, I, I).

The largest coefficients are kept until there are `sparsity` or the mean squared error is `error`; of
all dictionaries the sparsest wins, among equals the one of least error.

Returns positions (n, sparsity; in C order of the coefficients) and values (n, sparsity), larger
magnitude first, then zeros, counts (n,), members (n,) and errors (n,; squared).
Kavoosighafi et al. 2023, Section 3.3. Raises ValueError (one line that names the argument) and
Cancelled.)");
}

}  // namespace nacre::python
