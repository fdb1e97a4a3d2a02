#include "nacre/table_evaluator.hpp"

#include <cmath>
#include <memory>

#include "bindings.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

using Floats = py::array_t<float, py::array::c_style>;
using Doubles = py::array_t<double, py::array::c_style>;
using Ids = py::array_t<std::uint32_t, py::array::c_style>;

constexpr Index kAlone = 8192;  // values that are not worth a second thread

// The evaluator with the arrays it reads.
struct Held {
    Floats core, light, view;
    Ids light_index, view_index;
    std::unique_ptr<TableEvaluator> evaluator;
};

std::string shape_of(const py::array& array) {
    return py::str(array.attr("shape")).cast<std::string>();
}

void require_shape(const py::array& array, const char* name, std::vector<Index> expected) {
    bool same = array.ndim() == static_cast<py::ssize_t>(expected.size());
    for (std::size_t n = 0; same && n < expected.size(); ++n) {
        same = array.shape(static_cast<py::ssize_t>(n)) == expected[n];
    }
    require(same, name, ": expected ", py::str(py::cast(expected)).cast<std::string>(), ", got ",
            shape_of(array));
}

std::unique_ptr<Held> make(const py::object& core, const py::object& light, const py::object& view,
                           const py::object& light_index, const py::object& view_index) {
    auto held = std::make_unique<Held>();
    held->core = array_argument<float>(core, "core", 7);
    held->view = array_argument<float>(view, "view", 6);
    held->light_index = array_argument<std::uint32_t>(light_index, "light_index", 3);
    held->view_index = array_argument<std::uint32_t>(view_index, "view_index", 3);
    Tables t;
    t.core = held->core.data();
    t.light_clusters = held->core.shape(0);
    t.view_clusters = held->core.shape(1);
    t.light_rank = held->core.shape(2);
    t.view_quads = held->core.shape(3);
    t.height = held->core.shape(4);
    t.width = held->core.shape(5);
    t.view = held->view.data();
    t.view_owners = held->view.shape(0);
    t.view_mixtures = held->view.shape(1);
    t.size = held->view.shape(3);
    t.light_mixtures = held->light_index.shape(0);
    t.light_index = held->light_index.data();
    t.view_index = held->view_index.data();
    require(held->core.shape(6) == 4, "core: expected quads, got ", shape_of(held->core));
    require_shape(held->view, "view",
                  {t.view_owners, t.view_mixtures, t.view_quads, t.size, t.size, 4});
    require_shape(held->light_index, "light_index", {t.light_mixtures, t.size, t.size});
    require_shape(held->view_index, "view_index", {t.view_mixtures, t.size, t.size});
    require(t.light_mixtures >= 1 && t.view_mixtures >= 1 && t.size >= 2,
            "view_index: expected mixtures and a map of 2 texels or more");
    if (!light.is_none()) {
        held->light = array_argument<float>(light, "light", 7);
        t.light = held->light.data();
        t.light_owners = held->light.shape(0);
        t.channels = held->light.shape(1);
        require_shape(
            held->light, "light",
            {t.light_owners, t.channels, t.light_mixtures, t.light_quads(), t.size, t.size, 4});
    }
    held->evaluator = std::make_unique<TableEvaluator>(t);
    return held;
}

// Finite numbers (n, columns).
Doubles rows_of(const py::object& value, const char* name, Index columns) {
    Doubles array = array_argument<double>(value, name, 2);
    require(array.shape(1) == columns, name, ": expected ", columns, " columns, got ",
            array.shape(1));
    for (py::ssize_t i = 0; i < array.size(); ++i) {
        require(std::isfinite(array.data()[i]), name, ": expected finite numbers, got ",
                array.data()[i], " in row ", i / columns);
    }
    return array;
}

std::span<const Vector3> vectors(const Doubles& array) {
    return {reinterpret_cast<const Vector3*>(array.data()), at(array.shape(0))};
}

py::array_t<float> patch(const Held& held, const py::object& light, const py::object& view,
                         int threads) {
    const Tables& t = held.evaluator->tables();
    const Doubles views = rows_of(view, "view", 3);
    Doubles lights(std::vector<py::ssize_t>{0, 3});
    std::vector<py::ssize_t> shape{views.shape(0), t.height, t.width};
    require(t.lit() != light.is_none(), "light: expected ",
            t.lit() ? "directions" : "none, as occlusion has none");
    if (t.lit()) {
        lights = rows_of(light, "light", 3);
        shape.insert(shape.begin(), lights.shape(0));
        shape.push_back(t.channels);
    }
    py::array_t<float> out(shape);
    float* values = out.mutable_data();
    const bool alone = out.size() < kAlone;
    const std::span<const Vector3> from = vectors(lights), to = vectors(views);
    const py::gil_scoped_release release;
    Executor executor(alone ? 1 : threads);
    held.evaluator->patch(executor, from, to, values);
    return out;
}

py::array_t<float> points(const Held& held, const py::object& light, const py::object& view,
                          const py::object& uv, int threads) {
    const Tables& t = held.evaluator->tables();
    const Doubles lights = rows_of(light, "light", 3), views = rows_of(view, "view", 3);
    const Doubles places = rows_of(uv, "uv", 2);
    const py::ssize_t count = places.shape(0);
    require(lights.shape(0) == count, "light: expected ", count, " directions, got ",
            lights.shape(0));
    require(views.shape(0) == count, "view: expected ", count, " directions, got ", views.shape(0));
    py::array_t<float> out(std::vector<py::ssize_t>{count, t.channels});
    float* values = out.mutable_data();
    const bool alone = out.size() < kAlone;
    const std::span<const Vector3> from = vectors(lights), to = vectors(views);
    const std::span<const double[2]> at_uv(reinterpret_cast<const double (*)[2]>(places.data()),
                                           at(count));
    const py::gil_scoped_release release;
    Executor executor(alone ? 1 : threads);
    held.evaluator->points(executor, from, to, at_uv, values);
    return out;
}

}  // namespace

void register_table_evaluator(py::module_& module) {
    py::class_<Held>(module, "TableEvaluator",
                     R"(Tables of a clustered Tucker model evaluated for any light and view.

core (C_light, C_view, R_light, view quads, Y, X, 4), light (owners, channels, K_light, light quads,
N, N, 4) or None for occlusion, view (owners, K_view, view quads, N, N, 4), light_index and
view_index (K, N, N). Arrays of these types in C order are not copied.
K-CTA, Section 6.3.3; MK-CTA, Section 5.1. Raises ValueError (one line that names the argument).)")
        .def(py::init(&make), py::arg("core"), py::arg("light"), py::arg("view"),
             py::arg("light_index"), py::arg("view_index"))
        .def("patch", &patch, py::arg("light"), py::arg("view"), py::kw_only(),
             py::arg("threads") = 0,
             R"(At texel centres for unit directions (n, 3): (light, view, Y, X, channel), clamped
at 0, and 0 for lights below the horizon; of occlusion, with light None, (view, Y, X) as it is.)")
        .def("points", &points, py::arg("light"), py::arg("view"), py::arg("uv"), py::kw_only(),
             py::arg("threads") = 0,
             R"(At n points (n, channel): unit light and view directions (n, 3) and texture
coordinates (n, 2) that repeat with the patch; bilinear, clamped at 0.)");
}

}  // namespace nacre::python
