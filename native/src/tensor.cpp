#include "nacre/tensor.hpp"

#include <algorithm>
#include <cstring>
#include <new>

#include "nacre/pages.hpp"

namespace nacre {

Index product(const Shape& shape) {
    Index size = 1;
    for (Index extent : shape) size *= extent;
    return size;
}

void BufferRelease::operator()(float* p) const {
    if (mapped > 0) {
        unmap(p, mapped);
    } else {
        std::free(p);
    }
}

Buffer& Buffer::operator=(Buffer&& other) noexcept {
    data_ = std::move(other.data_);
    capacity_ = std::exchange(other.capacity_, 0);
    return *this;
}

void Buffer::reserve(Index size) {
    if (size <= capacity_) return;
    *this = Buffer();  // free first: the old contents are not kept
    constexpr std::size_t kLine = 64;
    const std::size_t bytes = at(size) * sizeof(float);
    const std::size_t unit = bytes >= 2 * kHugePage ? kHugePage : kLine;
    const std::size_t whole = (bytes + unit - 1) / unit * unit;
    data_.reset(static_cast<float*>(std::aligned_alloc(unit, whole)));
    if (!data_) throw std::bad_alloc();
    if (unit == kHugePage) prefer_huge_pages(data_.get(), whole);
    capacity_ = size;
}

void Buffer::drop() const {
    if (mapped()) drop_pages(data_.get(), data_.get_deleter().mapped);
}

Tensor::Tensor(Shape shape, Buffer buffer)
    : shape_(std::move(shape)), size_(product(shape_)), buffer_(std::move(buffer)) {}

Tensor::Tensor(Tensor&& other) noexcept
    : shape_(std::move(other.shape_)),
      size_(std::exchange(other.size_, 0)),
      buffer_(std::move(other.buffer_)) {}

Tensor& Tensor::operator=(Tensor&& other) noexcept {
    shape_ = std::move(other.shape_);
    size_ = std::exchange(other.size_, 0);
    buffer_ = std::move(other.buffer_);
    return *this;
}

Tensor::Tensor(const Tensor& other) { *this = other; }

Tensor& Tensor::operator=(const Tensor& other) {
    if (this == &other) return *this;
    if (!other.data()) return *this = Tensor();
    reset(other.shape_);
    std::copy_n(other.data(), size_, data());
    return *this;
}

void Tensor::reset(Shape shape) {
    const Index size = product(shape);
    buffer_.reserve(std::max<Index>(size, 1));
    shape_ = std::move(shape);
    size_ = size;
}

void Tensor::fill(float value) { std::fill_n(data(), size_, value); }

Unfolding unfolding(const Shape& shape, Index mode) {
    Unfolding view{1, shape[at(mode)], 1};
    for (Index n = 0; n < static_cast<Index>(shape.size()); ++n) {
        if (n < mode) view.outer *= shape[at(n)];
        if (n > mode) view.inner *= shape[at(n)];
    }
    return view;
}

namespace {

// Calls run(offset in the whole tensor, offset in the block, run length) for every contiguous run.
template <class Run>
void for_each_run(const Shape& shape, const Shape& begin, const Shape& size, Run&& run) {
    const int order = static_cast<int>(shape.size());
    // Trailing modes that are taken whole make longer runs.
    int last = order - 1;
    Index length = order ? size[at(last)] : 1;
    while (last > 0 && size[at(last)] == shape[at(last)]) {
        --last;
        length *= size[at(last)];
    }
    Shape strides(shape.size());
    Index step = 1;
    for (int n = order - 1; n >= 0; --n) {
        strides[at(n)] = step;
        step *= shape[at(n)];
    }
    Index runs = 1;
    for (int n = 0; n < last; ++n) runs *= size[at(n)];
    Index base = 0;
    for (int n = 0; n < order; ++n) base += begin[at(n)] * strides[at(n)];
    Shape position(shape.size(), 0);
    for (Index r = 0; r < runs; ++r) {
        Index offset = base;
        for (int n = 0; n < last; ++n) offset += position[at(n)] * strides[at(n)];
        run(offset, r * length, length);
        for (int n = last - 1; n >= 0; --n) {
            if (++position[at(n)] < size[at(n)]) break;
            position[at(n)] = 0;
        }
    }
}

}  // namespace

void copy_out(const float* source, const Shape& shape, const Shape& begin, const Shape& size,
              float* block) {
    for_each_run(shape, begin, size, [&](Index from, Index to, Index length) {
        std::memcpy(block + to, source + from, at(length) * sizeof(float));
    });
}

void copy_in(const float* block, const Shape& begin, const Shape& size, const Shape& shape,
             float* destination) {
    for_each_run(shape, begin, size, [&](Index to, Index from, Index length) {
        std::memcpy(destination + to, block + from, at(length) * sizeof(float));
    });
}

}  // namespace nacre
