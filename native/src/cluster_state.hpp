// The model in the middle of a fit, on the reduced tensor whose clustered modes come first:
// (rows of each clustered mode..., columns), where the columns run over all other modes.
#pragma once

#include <vector>

#include "nacre/cluster_search.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// The clusters of one clustered mode.
struct Grouping {
    Index rows = 0;
    Index tied = 1;  // rows that share their clusters: one item
    Index count = 1;
    Index rank = 1;
    Index mixtures = 1;                       // at present: 1 while an MK-CTA is being started
    std::vector<ClusterId> of_item;           // items x mixtures, ascending
    std::vector<std::vector<Index>> members;  // rows of each cluster, ascending
    std::vector<Index> position;              // rows x mixtures: of the row among those members

    Index items() const { return rows / tied; }
    const ClusterId* of_row(Index row) const { return of_item.data() + row / tied * mixtures; }

    void assign(std::vector<ClusterId> clusters, Index new_mixtures);
};

class ClusterState {
  public:
    // `shape` and `ranks` have the clustered modes first; rank 0 leaves a mode in full.
    ClusterState(std::vector<Grouping> groupings, Shape shape, std::vector<Index> ranks);

    Index clustered() const { return static_cast<Index>(groupings.size()); }  // number of modes
    Index count() const { return count_; }                                    // of clusters
    Index columns() const { return columns_; }
    Index rows() const { return rows_; }            // product of the clustered modes' rows
    Index core_rows() const { return core_rows_; }  // product of their ranks
    const Shape& shape() const { return shape_; }
    const std::vector<Index>& ranks() const { return ranks_; }

    // The index of cluster c in clustered mode k, the owner that it belongs to there (the indices
    // of the other modes), and back.
    Index part(Index c, Index k) const { return c / stride_[at(k)] % groupings[at(k)].count; }
    Index owner(Index c, Index k) const;
    Index owners(Index k) const { return count_ / groupings[at(k)].count; }
    Index cluster(Index part, Index owner, Index k) const;

    const std::vector<Index>& members(Index c, Index k) const {
        return groupings[at(k)].members[at(part(c, k))];
    }
    bool overlap(Index a, Index b) const;

    // Rows of c's core with every other mode expanded: core_rows() x columns().
    float* spread(Index c) { return spread_.data() + c * core_rows_ * columns_; }
    const float* spread(Index c) const { return spread_.data() + c * core_rows_ * columns_; }
    const Tensor& spreads() const { return spread_; }
    // `to` becomes equal to `from` but for its members.
    void copy_cluster(Index from, Index to);
    void use_spread(Tensor spread) { spread_ = std::move(spread); }

    std::vector<Grouping> groupings;
    std::vector<Tensor> cores;                // modes as in shape()
    std::vector<std::vector<MatrixF>> bases;  // [cluster][mode]: members x R of a clustered mode,
                                              // I x R of another, empty where it is left in full

  private:
    Shape shape_;
    std::vector<Index> ranks_, stride_;
    Index count_ = 1, columns_ = 1, rows_ = 1, core_rows_ = 1;
    Tensor spread_;
};

}  // namespace nacre
