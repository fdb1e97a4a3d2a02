#include <algorithm>

#include "bindings.hpp"
#include "nacre/cluster_search.hpp"
#include "nacre/errors.hpp"

namespace nacre::python {

namespace {

void check_candidates(const py::array_t<ClusterId, py::array::c_style>& sets, Index clusters) {
    const Index mixtures = sets.shape(2);
    for (Index i = 0; i < sets.shape(0) * sets.shape(1); ++i) {
        const ClusterId* set = sets.data() + i * mixtures;
        for (Index k = 0; k < mixtures; ++k) {
            require(set[k] < clusters, "candidates: expected clusters below ", clusters, ", got ",
                    set[k], " for row ", i / sets.shape(1));
            require(std::find(set, set + k, set[k]) == set + k,
                    "candidates: expected distinct clusters, got ", set[k], " twice for row ",
                    i / sets.shape(1));
        }
    }
}

py::tuple find(const py::object& projections, const py::object& gram, Index mixtures,
               const py::object& candidates, const std::string& search, Index tied, int threads) {
    const auto rows = array_argument<double>(projections, "projections", 3);
    const auto blocks = array_argument<double>(gram, "gram", 4);
    const Index count = rows.shape(0), clusters = rows.shape(1), rank = rows.shape(2);
    require(clusters >= 1 && rank >= 1, "projections: expected (rows, clusters, rank), got (",
            count, ", ", clusters, ", ", rank, ")");
    require(blocks.shape(0) == clusters && blocks.shape(1) == clusters && blocks.shape(2) == rank &&
                blocks.shape(3) == rank,
            "gram: expected (", clusters, ", ", clusters, ", ", rank, ", ", rank, "), got (",
            blocks.shape(0), ", ", blocks.shape(1), ", ", blocks.shape(2), ", ", blocks.shape(3),
            ")");
    require(mixtures >= 1 && mixtures <= clusters, "mixtures: expected 1 to ", clusters,
            " (the clusters), got ", mixtures);
    require(tied >= 1 && count % tied == 0, "tied: expected a divisor of the ", count,
            " rows, got ", tied);
    const Index items = count / tied;
    MatrixD matrix(clusters * rank, clusters * rank);
    for (Index j = 0; j < clusters; ++j) {
        for (Index c = 0; c < clusters; ++c) {
            matrix.block(j * rank, c * rank, rank, rank) = Eigen::Map<const MatrixD>(
                blocks.data() + (j * clusters + c) * rank * rank, rank, rank);
        }
    }
    require(search == "kcta" || search == "greedy" || search == "optimal",
            "search: expected kcta, greedy or optimal, got ", search);
    require(matrix.allFinite(), "gram: expected finite numbers");
    require(Eigen::Map<const VectorD>(rows.data(), rows.size()).allFinite(),
            "projections: expected finite numbers");
    py::array_t<ClusterId, py::array::c_style> sets;
    Index set_count = 0;
    if (!candidates.is_none()) {
        sets = array_argument<ClusterId>(candidates, "candidates", 3);
        require(sets.shape(0) == items && sets.shape(2) == mixtures, "candidates: expected (",
                items, ", any, ", mixtures, "), got (", sets.shape(0), ", ", sets.shape(1), ", ",
                sets.shape(2), ")");
        check_candidates(sets, clusters);
        set_count = sets.shape(1);
    }
    Membership membership;
    {
        const py::gil_scoped_release release;
        Executor executor(threads);
        const std::span<const ClusterId> all(set_count ? sets.data() : nullptr,
                                             at(set_count ? sets.size() : 0));
        membership = search_clusters(executor, {rows.data(), count, tied, matrix, clusters, rank},
                                     mixtures, search_method(search), all, set_count);
    }
    return py::make_tuple(to_numpy(membership.clusters.data(), {items, mixtures}),
                          to_numpy(membership.coefficients.data(), {count, mixtures, rank}));
}

}  // namespace

void register_search(py::module_& module) {
    module.def("search_clusters", &find, py::arg("projections"), py::arg("gram"),
               py::arg("mixtures"), py::kw_only(), py::arg("candidates") = py::none(),
               py::arg("search") = "kcta", py::arg("tied") = 1, py::arg("threads") = 0,
               R"(Mixture clusters and mixing coefficients of any subtensors, in the reduced space.

projections (n, C, R): ufm(A<i>^(c)) ufm(Z_c)^T. gram (C, C, R, R): see core_gram. mixtures: K.
candidates (items, q, K): further sets of clusters for each item; whichever explains most energy after
optimal projection wins, the search's own in doubt. search: as in fit_clustered, but not "auto". tied:
rows that follow each other and share their clusters; items are n / tied.

Returns members (items, K) uint32, ascending in a row, and coefficients (n, K, R) float64.
Tsai and Shih 2012: greedy search, Eqs. 9 to 14, and optimal projection, Eq. 15; Tsai 2015: Eqs. 4,
8 and 11. Raises ValueError (one line that names the argument).)");
}

}  // namespace nacre::python
