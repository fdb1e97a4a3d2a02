#include "nacre/clustered.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "clustered_fit.hpp"
#include "model_conversion.hpp"
#include "nacre/errors.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/nsvd.hpp"
#include "nacre/streaming.hpp"

namespace nacre {

namespace {

void validate(const TensorSource& source, const ClusteredOptions& options) {
    const Shape& shape = source.shape();
    const Index order = static_cast<Index>(shape.size());
    require(static_cast<Index>(options.ranks.size()) == order, "ranks: expected ", order,
            " numbers, got ", options.ranks.size());
    for (Index n = 0; n < order; ++n) {
        require(options.ranks[at(n)] >= 1 && options.ranks[at(n)] <= shape[at(n)],
                "ranks: expected 1 to ", shape[at(n)], " for mode ", n, ", got ",
                options.ranks[at(n)]);
    }
    require(!options.clustered.empty(), "clusters: expected at least one clustered mode");
    std::vector<bool> clustered(shape.size(), false), seen(shape.size(), false);
    Index last = -1;
    for (const ClusteredMode& mode : options.clustered) {
        require(mode.mode > last && mode.mode < order,
                "clusters: expected distinct modes from 0 to ", order - 1, ", got ", mode.mode);
        last = mode.mode;
        clustered[at(mode.mode)] = true;
        const Index items = shape[at(mode.mode)] / source.granularity(mode.mode);
        require(mode.clusters >= 1 && mode.clusters <= items, "clusters: expected 1 to ", items,
                " for mode ", mode.mode, ", got ", mode.clusters);
        require(mode.mixtures >= 1 && mode.mixtures <= mode.clusters, "mixtures: expected 1 to ",
                mode.clusters, " (the clusters) for mode ", mode.mode, ", got ", mode.mixtures);
        require(mode.parameters.rows() == items, "directions: expected ", items, " rows for mode ",
                mode.mode, ", got ", mode.parameters.rows());
        require(mode.parameters.allFinite(), "directions: expected finite numbers");
    }
    for (Index mode : options.global_modes) {
        require(mode >= 0 && mode < order && !clustered[at(mode)] && !seen[at(mode)],
                "global_modes: expected distinct modes from 0 to ", order - 1,
                " that are not clustered, got ", mode);
        seen[at(mode)] = true;
    }
    require(options.iterations >= 0, "iterations: expected 0 or more, got ", options.iterations);
    require(options.tolerance >= 0, "tolerance: expected 0 or more, got ", options.tolerance);
}

// A start must be a model of these shapes, or without cores the global bases of one.
void validate(const TensorSource& source, const ClusteredOptions& options,
              const ClusteredTucker& start) {
    const auto fits = [](bool condition) {
        require(condition, "start: expected a model of the same shape and settings");
    };
    const std::size_t order = source.shape().size(), modes = options.clustered.size();
    fits(start.bases.size() == order && start.squared_norm >= 0);
    for (Index mode : options.global_modes) {
        const std::vector<MatrixF>& bases = start.bases[at(mode)];
        fits(bases.size() == 1 && bases[0].rows() == source.shape()[at(mode)] &&
             bases[0].cols() == options.ranks[at(mode)]);
    }
    if (start.cores.empty()) return;
    Index count = 1;
    for (const ClusteredMode& mode : options.clustered) count *= mode.clusters;
    fits(static_cast<Index>(start.cores.size()) == count && start.members.size() == modes);
    for (const Tensor& core : start.cores) fits(core.shape() == options.ranks);
    std::vector<Index> mixtures(order, 1), owners(order, count);
    for (std::size_t k = 0; k < modes; ++k) {
        const ClusteredMode& mode = options.clustered[k];
        const Index items = source.shape()[at(mode.mode)] / source.granularity(mode.mode);
        const Index size = static_cast<Index>(start.members[k].size());
        fits(size == items || size == items * mode.mixtures);
        mixtures[at(mode.mode)] = size / items;
        owners[at(mode.mode)] = count / mode.clusters;
        for (Index i = 0; i < size; ++i) {
            const bool first = i % mixtures[at(mode.mode)] == 0;
            fits(start.members[k][at(i)] < mode.clusters &&
                 (first || start.members[k][at(i)] > start.members[k][at(i - 1)]));
        }
    }
    for (Index mode : options.global_modes) owners[at(mode)] = 1;
    for (std::size_t n = 0; n < order; ++n) {
        fits(static_cast<Index>(start.bases[n].size()) == owners[n]);
        for (const MatrixF& basis : start.bases[n]) {
            fits(basis.rows() == source.shape()[n] &&
                 basis.cols() == mixtures[n] * options.ranks[n]);
        }
    }
}

// The order of modes that the fit works in: clustered modes first.
std::vector<Index> fitting_order(Index order, const ClusteredOptions& options) {
    std::vector<Index> modes;
    for (const ClusteredMode& mode : options.clustered) modes.push_back(mode.mode);
    for (Index n = 0; n < order; ++n) {
        const auto is = [n](const ClusteredMode& mode) { return mode.mode == n; };
        if (std::none_of(options.clustered.begin(), options.clustered.end(), is)) {
            modes.push_back(n);
        }
    }
    return modes;
}

// Bytes that decomposing one cluster takes besides the tensors of a Workspace: its core's rows with
// the other modes expanded, four times over, and the members projected on all bases but one.
std::size_t scratch_bytes(const Shape& shape, const ClusteredOptions& options) {
    const auto has = [](const std::vector<Index>& modes, Index n) {
        return std::find(modes.begin(), modes.end(), n) != modes.end();
    };
    std::vector<Index> clustered;
    for (const ClusteredMode& mode : options.clustered) clustered.push_back(mode.mode);
    Index core_rows = 1, columns = 1, projected = 1;
    for (Index n = 0; n < static_cast<Index>(shape.size()); ++n) {
        const Index rank = options.ranks[at(n)];
        if (has(clustered, n)) {
            core_rows *= rank;
        } else {
            columns *= has(options.global_modes, n) ? rank : shape[at(n)];
            projected *= rank;
        }
    }
    Index rest = 0;
    for (Index mode : clustered) {
        rest = std::max(rest, shape[at(mode)] * core_rows / options.ranks[at(mode)] * projected);
    }
    return at(4 * core_rows * columns + 2 * rest) * sizeof(float);
}

}  // namespace

ClusteredTucker fit_clustered(Executor& executor, const Workspace& workspace,
                              const TensorSource& source, const ClusteredOptions& options,
                              const ClusteredTucker* start, const ClusteredCheckpoint& checkpoint) {
    validate(source, options);
    const Shape& shape = source.shape();
    const Index order = static_cast<Index>(shape.size());
    if (start) validate(source, options, *start);
    const bool resumes = start && !start->cores.empty();

    // Section 5.2 of the K-CTA paper: global bases first, with every other mode in full.
    std::vector<MatrixF> globals(at(order));
    double energy = -1;
    if (start) {
        energy = start->squared_norm;
        for (Index mode : options.global_modes) globals[at(mode)] = start->bases[at(mode)][0];
    } else if (options.global_modes.size() == 1) {
        const Index mode = options.global_modes[0];
        executor.stage(0, 0.3, "Global basis: covariance");
        const MatrixD covariance = gram(executor, source, mode);
        energy = covariance.trace();
        globals[at(mode)] = leading_basis(covariance, options.ranks[at(mode)]);
    } else if (options.global_modes.size() > 1) {
        // One sweep: further ones change the bound that these bases set by some 0.003 dB.
        NsvdOptions global;
        global.ranks.assign(at(order), 0);
        global.iterations = 1;
        global.core = false;
        global.workspace = workspace;
        for (Index mode : options.global_modes) global.ranks[at(mode)] = options.ranks[at(mode)];
        Tucker tucker = nsvd(executor, source, global);
        energy = tucker.squared_norm;
        globals = std::move(tucker.bases);
    }
    if (!start && checkpoint && !options.global_modes.empty()) {
        ClusteredTucker state;
        state.bases.resize(at(order));
        for (Index mode : options.global_modes) state.bases[at(mode)] = {globals[at(mode)]};
        state.squared_norm = energy;
        checkpoint(state);
    }

    const std::vector<Index> modes = fitting_order(order, options);
    workspace.set_aside(scratch_bytes(shape, options));
    executor.stage(0.3, 0.4, "Projection on the global bases");
    Bases bases(at(order), nullptr);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        if (globals[n].size() > 0) bases[n] = &globals[n];
    }
    Tensor reduced = project(executor, source, bases, modes, workspace);
    if (energy < 0) {
        energy = squared_norm(executor, reduced);
        if (!std::isfinite(energy)) source.throw_invalid();
    }
    ClusteredFit fit(executor, workspace, source, options, modes, globals, std::move(reduced),
                     energy);
    if (resumes) {
        fit.start_from(*start);
    } else {
        fit.start();
    }
    fit.iterate(checkpoint);
    executor.stage(1, 1, "Done");
    return fit.model();
}

}  // namespace nacre
