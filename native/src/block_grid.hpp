// Blocks of a tensor that is read piece by piece.
#pragma once

#include <algorithm>
#include <vector>

#include "nacre/source.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

inline constexpr Index kBlockFloats = 1 << 17;  // half a megabyte: half a core's second cache

// Cuts a tensor into blocks that hold the modes in `whole` in full and are of kBlockFloats if these
// leave room, else as small as they can be.
class BlockGrid {
  public:
    BlockGrid(const TensorSource& source, const std::vector<bool>& whole)
        : shape_(source.shape()), chunk_(shape_) {
        Index floats = 1;
        for (std::size_t n = 0; n < shape_.size(); ++n) {
            if (!whole[n]) chunk_[n] = source.granularity(static_cast<Index>(n));
            floats *= chunk_[n];
        }
        // Grow from the last mode on, for long contiguous runs; then even the chunks out.
        for (std::size_t n = shape_.size(); n-- > 0;) {
            if (whole[n]) continue;
            const Index grain = chunk_[n];
            const Index grains = shape_[n] / grain;
            const Index fit = std::clamp<Index>(kBlockFloats / floats, 1, grains);
            const Index count = (grains + fit - 1) / fit;
            floats /= grain;
            chunk_[n] = grain * ((grains + count - 1) / count);
            floats *= chunk_[n];
        }
        for (std::size_t n = 0; n < shape_.size(); ++n) {
            counts_.push_back((shape_[n] + chunk_[n] - 1) / chunk_[n]);
        }
    }

    Index size() const { return product(counts_); }
    Index block_floats() const { return product(chunk_); }
    const Shape& chunk() const { return chunk_; }

    void block(Index number, Shape& begin, Shape& size) const {
        begin.resize(shape_.size());
        size.resize(shape_.size());
        for (std::size_t n = shape_.size(); n-- > 0;) {
            begin[n] = number % counts_[n] * chunk_[n];
            number /= counts_[n];
            size[n] = std::min(chunk_[n], shape_[n] - begin[n]);
        }
    }

  private:
    Shape shape_, chunk_, counts_;
};

}  // namespace nacre
