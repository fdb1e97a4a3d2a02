#include "clustered_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "clustering_stage.hpp"
#include "model_conversion.hpp"
#include "nacre/kmeans.hpp"
#include "nacre/mode_product.hpp"

namespace nacre {

namespace {

constexpr int kFirstSweeps = 3;  // of the N-SVD of each first cluster
constexpr int kSweeps = 1;       // of that of an update, which starts from the last result
// MK-CTA begins with K = 1 in every mode (Section 4.2), until the error falls by less than this
// part or so many iterations are done.
constexpr double kWarmUpTolerance = 0.02;
constexpr std::size_t kWarmUpIterations = 4;

ClusterState first_state(const TensorSource& source, const ClusteredOptions& options,
                         const std::vector<Index>& modes, const std::vector<MatrixF>& globals,
                         const Shape& shape) {
    std::vector<Grouping> groupings;
    for (const ClusteredMode& mode : options.clustered) {
        Grouping grouping;
        grouping.rows = source.shape()[at(mode.mode)];
        grouping.tied = source.granularity(mode.mode);
        grouping.count = mode.clusters;
        grouping.rank = options.ranks[at(mode.mode)];
        groupings.push_back(std::move(grouping));
    }
    std::vector<Index> ranks;
    for (Index mode : modes) {
        ranks.push_back(globals[at(mode)].size() > 0 ? 0 : options.ranks[at(mode)]);
    }
    return ClusterState(std::move(groupings), shape, std::move(ranks));
}

// Moves an item from one cluster to another, with its coefficients.
void move_item(Membership& found, Index item, Index mixtures, Index tied, Index width,
               ClusterId from, ClusterId to) {
    ClusterId* clusters = found.clusters.data() + item * mixtures;
    Index slot = std::find(clusters, clusters + mixtures, from) - clusters;
    clusters[slot] = to;
    const auto swap_with = [&](Index other) {  // keeps the row ascending
        std::swap(clusters[slot], clusters[other]);
        for (Index row = item * tied; row < (item + 1) * tied; ++row) {
            double* values = found.coefficients.data() + row * mixtures * width;
            std::swap_ranges(values + slot * width, values + (slot + 1) * width,
                             values + other * width);
        }
        slot = other;
    };
    while (slot > 0 && clusters[slot] < clusters[slot - 1]) swap_with(slot - 1);
    while (slot + 1 < mixtures && clusters[slot] > clusters[slot + 1]) swap_with(slot + 1);
}

}  // namespace

ClusteredFit::ClusteredFit(Executor& executor, const Workspace& workspace,
                           const TensorSource& source, const ClusteredOptions& options,
                           std::vector<Index> modes, std::vector<MatrixF> globals, Tensor reduced,
                           double energy)
    : executor_(executor),
      options_(options),
      modes_(std::move(modes)),
      globals_(std::move(globals)),
      tensor_(std::move(reduced)),
      energy_(energy),
      state_(first_state(source, options, modes_, globals_, tensor_.shape())),
      residual_(workspace.tensor(tensor_.shape())),
      decomposition_(executor, workspace, state_) {
    state_.use_spread(workspace.tensor({state_.count() * state_.core_rows(), state_.columns()}));
    VectorD energies(state_.rows());
    executor_.parallel_for(state_.rows(), [&](Index row, int) {
        energies(row) = squared_norm(tensor_.data() + row * state_.columns(), state_.columns());
    });
    tensor_.drop();
    // A fit that starts from a model has not summed the samples' energy before.
    if (!std::isfinite(energies.sum())) source.throw_invalid();
    lost_energy_ = std::max(0.0, energy - energies.sum());
    Index stride = state_.rows();
    for (const Grouping& grouping : state_.groupings) {
        stride /= grouping.rows;
        VectorD sums = VectorD::Zero(grouping.rows);
        for (Index row = 0; row < state_.rows(); ++row) {
            sums(row / stride % grouping.rows) += energies(row);
        }
        row_energy_.push_back(std::move(sums));
    }
}

// Section 5.1 of the K-CTA paper: clusters in the parametric space, then one iteration of CTA.
void ClusteredFit::start() {
    executor_.stage(0.4, 0.5, "First clusters");
    for (std::size_t k = 0; k < state_.groupings.size(); ++k) {
        const ClusteredMode& mode = options_.clustered[k];
        const std::vector<Index> seeds = kmeans(mode.parameters, mode.clusters, options_.seed);
        state_.groupings[k].assign({seeds.begin(), seeds.end()}, 1);
    }
    executor_.parallel_for(state_.rows(), [&](Index row, int) {
        std::copy_n(tensor_.data() + row * state_.columns(), state_.columns(),
                    residual_.data() + row * state_.columns());
    });
    tensor_.drop();
    decomposition_.run(residual_, kFirstSweeps);
    errors_.push_back(error());
}

SearchMethod ClusteredFit::method(Index mixtures) const {
    if (options_.search != SearchMethod::kAuto) return options_.search;
    if (state_.clustered() == 1) return SearchMethod::kKcta;
    return mixtures < 3 ? SearchMethod::kOptimal : SearchMethod::kGreedy;
}

void ClusteredFit::iterate(const ClusteredCheckpoint& checkpoint) {
    double norms = core_norms();
    // K-CTA takes all mixture clusters from the first iteration on, MK-CTA once it has warmed up.
    bool warm = state_.clustered() == 1;
    while (static_cast<int>(errors_.size()) <= options_.iterations) {
        const std::size_t done = errors_.size();
        const double last = errors_.back();
        warm = warm || all_mixtures() || done > kWarmUpIterations ||
               (done > 1 && errors_[done - 2] - last <= kWarmUpTolerance * last);
        const bool grows = warm && !all_mixtures();
        if (checkpoint) checkpoint(model(false));
        const double share = 0.5 / (options_.iterations + 1);
        const double begin = 0.5 + share * static_cast<double>(done - 1);
        const std::string name = "Iteration " + std::to_string(done);
        executor_.stage(begin, begin + share / 2, name + ": clustering");
        const Snapshot before{state_.groupings, state_.cores, state_.bases};
        cluster_modes(warm);
        residual(executor_, state_, tensor_, residual_);
        executor_.stage(begin + share / 2, begin + share, name + ": decomposition");
        decomposition_.run(residual_, kSweeps);
        const double error = this->error();
        if (error > last) {
            // Section 5.3 of the K-CTA paper, 5.4 of the MK-CTA paper: the last result again.
            restore(before);
            if (warm) break;
            warm = true;
            continue;
        }
        errors_.push_back(error);
        const double now = core_norms();
        // The norms alone say little where the error is a small part of the energy.
        const bool converged = std::abs(now - norms) <= options_.tolerance * norms &&
                               last - error <= options_.tolerance * last;
        norms = now;
        if (converged && warm && !grows) break;
    }
}

bool ClusteredFit::all_mixtures() const {
    for (std::size_t k = 0; k < state_.groupings.size(); ++k) {
        if (state_.groupings[k].mixtures < options_.clustered[k].mixtures) return false;
    }
    return true;
}

void ClusteredFit::restore(const Snapshot& snapshot) {
    state_.groupings = snapshot.groupings;
    state_.cores = snapshot.cores;
    state_.bases = snapshot.bases;
    spread_cores();
}

void ClusteredFit::spread_cores() {
    Tensor a, b;
    for (Index c = 0; c < state_.count(); ++c) spread_core(executor_, state_, c, a, b);
}

// The clustering stage: mode by mode, everything else fixed (Section 3.5).
void ClusteredFit::cluster_modes(bool warm) {
    MatrixD spreads = spread_gram(executor_, state_);
    for (Index k = 0; k < state_.clustered(); ++k) {
        const Grouping& grouping = state_.groupings[at(k)];
        const Index mixtures = warm ? options_.clustered[at(k)].mixtures : 1;
        const Index width = grouping.rank * state_.owners(k);
        MatrixD gram = subset_gram(executor_, state_, k, spreads);
        MatrixD projections = subset_projections(executor_, state_, k, tensor_);
        const SearchMethod search = method(mixtures);
        // Greedy search may lose against the clusters that an item has (Section 5.4); it keeps them
        // where they explain more, so that the stage never raises the error. K-CTA has no such
        // rule.
        const bool compare = search == SearchMethod::kGreedy && mixtures == grouping.mixtures;
        const std::vector<ClusterId> present = grouping.of_item;
        Membership found = search_clusters(
            executor_,
            {projections.data(), grouping.rows, grouping.tied, gram, grouping.count, width},
            mixtures, search, compare ? std::span(present) : std::span<const ClusterId>(), compare);
        const bool split = split_empty(k, projections, gram, mixtures, found);
        assign(k, found, mixtures);
        // The modes that follow must see the cores that a split has copied.
        if (split && k + 1 < state_.clustered()) spreads = spread_gram(executor_, state_);
    }
}

void ClusteredFit::assign(Index k, const Membership& found, Index mixtures) {
    Grouping& grouping = state_.groupings[at(k)];
    grouping.assign(found.clusters, mixtures);
    const Index rank = grouping.rank, owners = state_.owners(k);
    for (Index c = 0; c < state_.count(); ++c) {
        state_.bases[at(c)][at(k)].resize(static_cast<Index>(state_.members(c, k).size()), rank);
    }
    for (Index row = 0; row < grouping.rows; ++row) {
        for (Index slot = 0; slot < mixtures; ++slot) {
            const Index part = grouping.of_row(row)[slot];
            const double* values =
                found.coefficients.data() + (row * mixtures + slot) * owners * rank;
            const Index position = grouping.position[at(row * mixtures + slot)];
            for (Index owner = 0; owner < owners; ++owner) {
                float* to = state_.bases[at(state_.cluster(part, owner, k))][at(k)].data();
                for (Index r = 0; r < rank; ++r) {
                    to[position * rank + r] = static_cast<float>(values[owner * rank + r]);
                }
            }
        }
    }
    // The post-process (Section 3.5.3; 4.2.3 of the K-CTA paper) would now make each basis
    // orthonormal and take what is left into the core. The other clusters see only their product,
    // so that is left to the decomposition, which needs it.
}

// Section 5.3 of the K-CTA paper: an empty cluster takes over half of the one with the largest
// error, the members that are approximated worst. It starts as its copy, so that nothing changes
// until it is updated. Returns whether there was one.
bool ClusteredFit::split_empty(Index k, MatrixD& projections, MatrixD& gram, Index mixtures,
                               Membership& found) {
    const Grouping& grouping = state_.groupings[at(k)];
    const Index items = grouping.items(), width = grouping.rank * state_.owners(k);
    std::vector<std::vector<Index>> members(at(grouping.count));
    for (Index i = 0; i < items * mixtures; ++i) {
        members[at(found.clusters[at(i)])].push_back(i / mixtures);
    }
    // ||A<i> - its approximation||^2, all in the reduced space.
    const auto error_of = [&](Index item) {
        double sum = 0;
        for (Index row = item * grouping.tied; row < (item + 1) * grouping.tied; ++row) {
            VectorD u = VectorD::Zero(grouping.count * width);
            for (Index slot = 0; slot < mixtures; ++slot) {
                const Index part = found.clusters[at(item * mixtures + slot)];
                u.segment(part * width, width) = Eigen::Map<const VectorD>(
                    found.coefficients.data() + (row * mixtures + slot) * width, width);
            }
            sum += row_energy_[at(k)](row) - 2 * projections.row(row).dot(u) + u.dot(gram * u);
        }
        return std::max(0.0, sum);
    };
    bool split = false;
    for (Index empty = 0; empty < grouping.count; ++empty) {
        if (!members[at(empty)].empty()) continue;
        split = true;
        std::vector<double> errors(at(items));
        for (Index i = 0; i < items; ++i) errors[at(i)] = error_of(i);
        Index worst = -1;
        double largest = -1;
        for (Index c = 0; c < grouping.count; ++c) {
            if (members[at(c)].size() < 2) continue;
            double sum = 0;
            for (Index i : members[at(c)]) sum += errors[at(i)];
            if (sum > largest) {
                largest = sum;
                worst = c;
            }
        }
        // There is one with two members: K * items >= clusters memberships, and one is empty.
        std::vector<Index> sorted = members[at(worst)];
        std::stable_sort(sorted.begin(), sorted.end(),
                         [&](Index a, Index b) { return errors[at(a)] < errors[at(b)]; });
        const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() + 1) / 2);
        members[at(empty)].assign(middle, sorted.end());
        members[at(worst)].assign(sorted.begin(), middle);
        std::sort(members[at(worst)].begin(), members[at(worst)].end());
        for (Index item : members[at(empty)]) {
            move_item(found, item, mixtures, grouping.tied, width, static_cast<ClusterId>(worst),
                      static_cast<ClusterId>(empty));
        }
        gram.middleRows(empty * width, width) = gram.middleRows(worst * width, width).eval();
        gram.middleCols(empty * width, width) = gram.middleCols(worst * width, width).eval();
        projections.middleCols(empty * width, width) =
            projections.middleCols(worst * width, width).eval();
        for (Index owner = 0; owner < state_.owners(k); ++owner) {
            state_.copy_cluster(state_.cluster(worst, owner, k), state_.cluster(empty, owner, k));
        }
    }
    return split;
}

double ClusteredFit::error() {
    if (energy_ <= 0) return 0;
    return (lost_energy_ + squared_norm(executor_, residual_)) / energy_;
}

double ClusteredFit::core_norms() const {
    double sum = 0;
    for (const Tensor& core : state_.cores)
        sum += std::sqrt(squared_norm(core.data(), core.size()));
    return sum;
}

ClusteredTucker ClusteredFit::model(bool complete) const {
    return to_model(state_, options_, modes_, globals_, errors_, energy_, complete);
}

void ClusteredFit::start_from(const ClusteredTucker& model) {
    from_model(model, modes_, state_);
    spread_cores();
    errors_ = model.errors;
    if (!errors_.empty()) return;
    residual(executor_, state_, tensor_, residual_);
    errors_.push_back(error());
}

}  // namespace nacre
