#include "nacre/patches.hpp"

#include <cmath>

#include "nacre/errors.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/pages.hpp"
#include "nacre/unpack.hpp"

namespace nacre {

Patches::Patches(const void* values, SampleType type, Index count, Shape shape, bool drop)
    : values_(values),
      type_(type),
      count_(count),
      size_(product(shape)),
      shape_(std::move(shape)),
      drop_(drop) {
    require(count_ > 0 && size_ > 0, "patches: expected at least one value");
    require(size_ < Index{1} << 31, "patches: expected fewer than 2^31 values each, got ", size_);
}

double Patches::read(Index patch, float* values) const {
    unpack(values_, type_, patch * size_, size_, 1, values, 0);
    if (drop_) {
        const Index bytes = size_ * (type_ == SampleType::kHalf ? 2 : 4);
        drop_pages(static_cast<const char*>(values_) + patch * bytes, at(bytes));
    }
    const double norm = squared_norm(values, size_);
    require(std::isfinite(norm), "patches: expected finite numbers, got others in patch ", patch);
    return norm;
}

}  // namespace nacre
