// One pass over a source that projects it block by block: what every pass is made of.
#pragma once

#include <vector>

#include "block_grid.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// B = A x_k U_k^T over every mode k with a basis, in blocks. A block holds in full the modes with a
// basis and the mode `whole` (-1: none). If they are too large to be read at once, one of the modes
// with a basis is read part by part: the others are contracted in each part, this one in the end.
class ProjectionPass {
  public:
    struct Scratch {
        Buffer a, b, gathered, sum;
    };

    ProjectionPass(const TensorSource& source, Bases bases, Index whole);

    Index blocks() const { return grid_.size(); }
    const Shape& result_shape() const { return result_shape_; }

    // Block number `block` of B, in `scratch`; `begin` and `size` are its place in B.
    const float* run(Index block, Scratch& scratch, Shape& begin, Shape& size) const;

  private:
    void choose_split();
    const float* contract_all(const std::vector<Index>& modes, Shape& size, Scratch& scratch) const;
    const float* run_split(Shape& begin, Shape& size, Scratch& scratch) const;

    const TensorSource& source_;
    const Bases bases_;
    const BlockGrid grid_;
    std::vector<Index> order_;  // in which modes are contracted
    Shape result_shape_;
    Index split_ = -1;    // the mode that is read part by part, last in order_; -1: none
    Index part_ = 0;      // its rows in a part
    Index gathered_ = 0;  // its rows that are contracted at once, several parts
};

}  // namespace nacre
