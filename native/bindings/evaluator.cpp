#include "nacre/evaluator.hpp"

#include <map>

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

using Floats = py::array_t<float, py::array::c_style>;
using Ids = py::array_t<std::uint32_t, py::array::c_style>;
using Indices = py::array_t<Index, py::array::c_style>;

constexpr Index kAlone = 8192;  // values that are not worth a second thread

std::unique_ptr<Evaluator> make_evaluator(const py::object& core, const py::list& basis,
                                          const std::map<int, py::object>& members,
                                          const std::map<int, Index>& clusters, Index channels,
                                          int threads) {
    require(basis.size() == 4, "basis: expected 4 arrays, got ", basis.size());
    const Floats values = array_argument<float>(core, "core", 5);
    Evaluator::Model model;
    model.core = values.data();
    model.channels = channels;
    std::vector<Floats> bases;
    std::vector<Ids> sets;
    sets.reserve(4);
    Index count = 1;
    for (const auto& [mode, number] : clusters) {
        require(mode >= 0 && mode < 4, "clusters: expected modes from 0 to 3, got ", mode);
        require(number >= 1, "clusters: expected 1 or more, got ", number, " for mode ", mode);
        require(members.count(mode) == 1, "members: expected those of the clustered mode ", mode);
        count *= number;
    }
    require(members.size() == clusters.size(), "members: expected clustered modes only");
    require(values.shape(0) == count, "core: expected ", count, " clusters, got ", values.shape(0));
    for (int n = 0; n < 4; ++n) {
        const std::size_t mode = at(n);
        bases.push_back(array_argument<float>(basis[mode], "basis", 4));
        const Floats& rows = bases.back();
        Evaluator::Mode& to = model.modes[mode];
        to.basis = rows.data();
        to.owners = rows.shape(0);
        to.rows = rows.shape(1);
        to.mixtures = rows.shape(2);
        to.rank = rows.shape(3);
        require(to.rank == values.shape(n + 1), "basis: expected rank ", values.shape(n + 1),
                " for mode ", n, " as the core has, got ", to.rank);
        if (!clusters.count(n)) {
            require(to.mixtures == 1, "basis: expected 1 mixture for mode ", n,
                    ", which is not clustered, got ", to.mixtures);
            continue;
        }
        to.clusters = clusters.at(n);
        sets.push_back(array_argument<std::uint32_t>(members.at(n), "members", 2));
        // Lights of a wrong number of channels cannot be counted: check() says so.
        const bool counted = n != 0 || (channels >= 1 && to.rows % channels == 0);
        const Index items = n == 0 && counted ? to.rows / channels : to.rows;
        require(!counted || (sets.back().shape(0) == items && sets.back().shape(1) == to.mixtures),
                "members: expected (", items, ", ", to.mixtures, ") for mode ", n, ", got (",
                sets.back().shape(0), ", ", sets.back().shape(1), ")");
        to.members = sets.back().data();
    }
    Evaluator::check(model);
    const py::gil_scoped_release release;
    Executor executor(threads);
    return std::make_unique<Evaluator>(executor, model);
}

// A number or a list of numbers from 0 to `size` - 1.
Indices indices(const py::object& value, const char* name, Index size, py::ssize_t most) {
    auto array = py::array_t<Index, py::array::c_style | py::array::forcecast>::ensure(value);
    const py::array given = py::array::ensure(value);
    if (!array || !given || (given.dtype().kind() != 'i' && given.dtype().kind() != 'u')) {
        PyErr_Clear();
        throw py::value_error(std::string(name) + ": expected whole numbers");
    }
    require(array.ndim() <= most, name, ": expected at most ", most, " dimensions, got ",
            array.ndim());
    for (py::ssize_t i = 0; i < array.size(); ++i) {
        require(array.data()[i] >= 0 && array.data()[i] < size, name, ": expected 0 to ", size - 1,
                ", got ", array.data()[i]);
    }
    return array;
}

py::array_t<float> decode_texels(const Evaluator& evaluator, const py::object& light,
                                 const py::object& view, const py::object& texels, int threads) {
    const Indices lights = indices(light, "light", evaluator.lights(), 1);
    const Indices views = indices(view, "view", evaluator.views(), 1);
    const Indices places = indices(texels, "texels", evaluator.height() * evaluator.width(), 2);
    require(lights.ndim() == views.ndim() && lights.size() == views.size(),
            "view: expected as many as lights, ", lights.size(), ", got ", views.size());
    require(places.ndim() >= 1, "texels: expected a list");
    const bool shared = places.ndim() == 1;
    require(shared || (lights.ndim() == 1 && places.shape(0) == lights.size()),
            "texels: expected one list, or one for each of ", lights.size(),
            " pairs of light and view");
    const Index count = places.shape(places.ndim() - 1);
    std::vector<py::ssize_t> shape;
    if (lights.ndim() == 1) shape.push_back(lights.size());
    shape.push_back(count);
    shape.push_back(evaluator.channels());
    py::array_t<float> out(shape);
    float* values = out.mutable_data();
    const auto span = [](const Indices& array) {
        return std::span<const Index>(array.data(), at(array.size()));
    };
    const bool alone = lights.size() * count < kAlone;
    const py::gil_scoped_release release;
    Executor executor(alone ? 1 : threads);
    evaluator.decode(executor, span(lights), span(views), span(places), shared, values);
    return out;
}

}  // namespace

void register_evaluator(py::module_& module) {
    py::class_<Evaluator>(module, "Evaluator",
                          R"(Random access to a clustered Tucker model of a BTF.

core (clusters, RL, RV, RY, RX) and basis, a list of (owners, I, K, R) arrays, as the fits return
them; members {mode: (items, K)} and clusters {mode: C} of the clustered modes, empty for N-SVD.
Expands the y and x modes for every texel, in `nbytes` bytes: a texel's values for one light and
view then take `reads` core values, of which the zero ones are left out.
Tsai 2015, Section 5.1. Raises ValueError (one line that names the argument).)")
        .def(py::init(&make_evaluator), py::arg("core"), py::arg("basis"),
             py::arg("members") = std::map<int, py::object>(),
             py::arg("clusters") = std::map<int, Index>(), py::kw_only(), py::arg("channels") = 3,
             py::arg("threads") = 0)
        .def("decode_texels", &decode_texels, py::arg("light"), py::arg("view"), py::arg("texels"),
             py::kw_only(), py::arg("threads") = 0,
             R"(Unclamped values at texels y * width + x, all channels, float32.

light, view: a number each, or as many of both: pairs. texels: (n,), or (pairs, n) for a list of its
own for each pair. Returns (n, channels), or (pairs, n, channels). threads: 0 for all.)")
        .def_property_readonly(
            "shape",
            [](const Evaluator& e) {
                return py::make_tuple(e.lights(), e.views(), e.height(), e.width(), e.channels());
            },
            "(light, view, y, x, channel)")
        .def_property_readonly("reads", &Evaluator::reads)
        .def_property_readonly("nbytes", &Evaluator::bytes);
}

}  // namespace nacre::python
