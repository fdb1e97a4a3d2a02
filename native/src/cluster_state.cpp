#include "cluster_state.hpp"

#include <algorithm>

namespace nacre {

void Grouping::assign(std::vector<ClusterId> clusters, Index new_mixtures) {
    of_item = std::move(clusters);
    mixtures = new_mixtures;
    members.assign(at(count), {});
    position.resize(at(rows * mixtures));
    for (Index row = 0; row < rows; ++row) {
        for (Index k = 0; k < mixtures; ++k) {
            std::vector<Index>& list = members[at(of_row(row)[k])];
            position[at(row * mixtures + k)] = static_cast<Index>(list.size());
            list.push_back(row);
        }
    }
}

ClusterState::ClusterState(std::vector<Grouping> given, Shape shape, std::vector<Index> ranks)
    : groupings(std::move(given)), shape_(std::move(shape)), ranks_(std::move(ranks)) {
    const std::size_t modes = groupings.size();
    stride_.resize(modes);
    for (std::size_t k = modes; k-- > 0;) {
        stride_[k] = count_;
        count_ *= groupings[k].count;
        rows_ *= groupings[k].rows;
        core_rows_ *= groupings[k].rank;
    }
    for (std::size_t n = modes; n < shape_.size(); ++n) columns_ *= shape_[n];
    cores.resize(at(count_));
    bases.assign(at(count_), std::vector<MatrixF>(shape_.size()));
}

Index ClusterState::owner(Index c, Index k) const {
    Index result = 0;
    for (Index q = 0; q < clustered(); ++q) {
        if (q != k) result = result * groupings[at(q)].count + part(c, q);
    }
    return result;
}

Index ClusterState::cluster(Index part, Index owner, Index k) const {
    Index result = part * stride_[at(k)];
    for (Index q = clustered(); q-- > 0;) {
        if (q == k) continue;
        result += owner % groupings[at(q)].count * stride_[at(q)];
        owner /= groupings[at(q)].count;
    }
    return result;
}

bool ClusterState::overlap(Index a, Index b) const {
    for (Index k = 0; k < clustered(); ++k) {
        if (part(a, k) == part(b, k)) continue;
        const std::vector<Index>&first = members(a, k), &second = members(b, k);
        auto i = first.begin(), j = second.begin();
        while (i != first.end() && j != second.end() && *i != *j) *i < *j ? ++i : ++j;
        if (i == first.end() || j == second.end()) return false;
    }
    return true;
}

void ClusterState::copy_cluster(Index from, Index to) {
    cores[at(to)] = cores[at(from)];
    bases[at(to)] = bases[at(from)];
    std::copy_n(spread(from), core_rows_ * columns_, spread(to));
}

}  // namespace nacre
