#include "model_conversion.hpp"

#include <algorithm>

namespace nacre {

namespace {

std::vector<Index> inverse(const std::vector<Index>& order) {
    std::vector<Index> result(order.size());
    for (std::size_t n = 0; n < order.size(); ++n) result[at(order[n])] = static_cast<Index>(n);
    return result;
}

// The clusters of every item, K of them. Where a fit has not got beyond its hard clusters, others
// join with coefficients 0.
std::vector<ClusterId> filled(const Grouping& grouping, Index mixtures) {
    std::vector<ClusterId> result;
    for (Index item = 0; item < grouping.items(); ++item) {
        const ClusterId* own = grouping.of_item.data() + item * grouping.mixtures;
        std::vector<ClusterId> set(own, own + grouping.mixtures);
        for (ClusterId c = 0; static_cast<Index>(set.size()) < mixtures; ++c) {
            if (std::find(set.begin(), set.end(), c) == set.end()) set.push_back(c);
        }
        std::sort(set.begin(), set.end());
        result.insert(result.end(), set.begin(), set.end());
    }
    return result;
}

}  // namespace

Tensor permuted(const Tensor& tensor, const std::vector<Index>& order) {
    Shape shape, stride(order.size());
    for (Index mode : order) shape.push_back(tensor.dim(mode));
    for (std::size_t n = 0; n < order.size(); ++n) {
        stride[n] = unfolding(tensor.shape(), order[n]).inner;
    }
    Tensor result(shape);
    const std::size_t last = order.size() - 1;
    std::vector<Index> index(order.size(), 0);
    for (Index i = 0; i < result.size(); i += shape[last]) {
        Index offset = 0;
        for (std::size_t n = 0; n < last; ++n) offset += index[n] * stride[n];
        for (Index j = 0; j < shape[last]; ++j) {
            result.data()[i + j] = tensor.data()[offset + j * stride[last]];
        }
        for (std::size_t n = last; n-- > 0 && ++index[n] == shape[n];) index[n] = 0;
    }
    return result;
}

ClusteredTucker to_model(const ClusterState& state, const ClusteredOptions& options,
                         const std::vector<Index>& modes, const std::vector<MatrixF>& globals,
                         const std::vector<double>& errors, double energy, bool complete) {
    ClusteredTucker model;
    for (const Tensor& core : state.cores) model.cores.push_back(permuted(core, inverse(modes)));
    model.bases.resize(modes.size());
    for (std::size_t n = 0; n < modes.size(); ++n) {
        std::vector<MatrixF>& bases = model.bases[at(modes[n])];
        if (globals[at(modes[n])].size() > 0) {
            bases.push_back(globals[at(modes[n])]);
            continue;
        }
        if (n >= state.groupings.size()) {
            for (Index c = 0; c < state.count(); ++c) bases.push_back(state.bases[at(c)][n]);
            continue;
        }
        const Index k = static_cast<Index>(n);
        const Grouping& grouping = state.groupings[n];
        const Index mixtures = complete ? options.clustered[n].mixtures : grouping.mixtures;
        std::vector<ClusterId> members = filled(grouping, mixtures);
        for (Index owner = 0; owner < state.owners(k); ++owner) {
            MatrixF basis = MatrixF::Zero(grouping.rows, mixtures * grouping.rank);
            for (Index row = 0; row < grouping.rows; ++row) {
                const ClusterId* set = members.data() + row / grouping.tied * mixtures;
                for (Index slot = 0; slot < grouping.mixtures; ++slot) {
                    const ClusterId part = grouping.of_row(row)[slot];
                    const Index to = std::find(set, set + mixtures, part) - set;
                    const Index c = state.cluster(part, owner, k);
                    const Index position = grouping.position[at(row * grouping.mixtures + slot)];
                    basis.block(row, to * grouping.rank, 1, grouping.rank) =
                        state.bases[at(c)][n].row(position);
                }
            }
            bases.push_back(std::move(basis));
        }
        model.members.push_back(std::move(members));
    }
    model.errors = errors;
    model.squared_norm = energy;
    return model;
}

void from_model(const ClusteredTucker& model, const std::vector<Index>& modes,
                ClusterState& state) {
    for (Index c = 0; c < state.count(); ++c) {
        state.cores[at(c)] = permuted(model.cores[at(c)], modes);
    }
    for (std::size_t n = 0; n < modes.size(); ++n) {
        const std::vector<MatrixF>& bases = model.bases[at(modes[n])];
        if (n >= state.groupings.size()) {
            for (Index c = 0; c < state.count() && state.ranks()[n] > 0; ++c) {
                state.bases[at(c)][n] = bases[at(c)];
            }
            continue;
        }
        const Index k = static_cast<Index>(n);
        Grouping& grouping = state.groupings[n];
        const Index mixtures = static_cast<Index>(model.members[n].size()) / grouping.items();
        grouping.assign(model.members[n], mixtures);
        for (Index c = 0; c < state.count(); ++c) {
            const MatrixF& from = bases[at(state.owner(c, k))];
            const std::vector<Index>& members = state.members(c, k);
            MatrixF& to = state.bases[at(c)][n];
            to.resize(static_cast<Index>(members.size()), grouping.rank);
            for (std::size_t i = 0; i < members.size(); ++i) {
                const ClusterId* set = grouping.of_row(members[i]);
                const Index slot =
                    std::find(set, set + mixtures, static_cast<ClusterId>(state.part(c, k))) - set;
                to.row(static_cast<Index>(i)) =
                    from.block(members[i], slot * grouping.rank, 1, grouping.rank);
            }
        }
    }
}

}  // namespace nacre
