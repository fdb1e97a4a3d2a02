// Patches of a BTF, the data points of SparseBTF (Section 3.1): tensors of one shape, one after the
// other, half or float, owned by the caller.
#pragma once

#include <atomic>

#include "nacre/source.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

class Patches {
  public:
    // `shape`: of one patch. `drop`: they are a shared or read-only mapping of a file, whose pages
    // are to be dropped behind the reader (see drop_pages).
    Patches(const void* values, SampleType type, Index count, Shape shape, bool drop = false);

    Index count() const { return count_; }
    const Shape& shape() const { return shape_; }
    Index order() const { return static_cast<Index>(shape_.size()); }
    Index size() const { return size_; }  // values of one patch

    // One patch as C-order floats; its squared norm. Throws std::invalid_argument where it holds
    // anything but finite numbers.
    double read(Index patch, float* values) const;

  private:
    const void* values_;
    SampleType type_;
    Index count_, size_;
    Shape shape_;
    bool drop_;
};

}  // namespace nacre
