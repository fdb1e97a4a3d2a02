// Dense float tensors in C order, and the matrices that go with them.
//
// A mode-n operation never forms the unfolded matrix: a C-order tensor is a stack of `outer`
// matrices of `rows` x `inner` (see Unfolding), and every product runs on these in place.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <utility>
#include <vector>

namespace nacre {

using Index = std::int64_t;
using Shape = std::vector<Index>;
using MatrixF = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using MatrixD = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using VectorD = Eigen::VectorXd;

// An Index as the subscript of a standard container.
inline std::size_t at(Index n) { return static_cast<std::size_t>(n); }

Index product(const Shape& shape);

// How the memory of a Buffer goes back.
struct BufferRelease {
    std::size_t mapped = 0;       // bytes of a mapping of a file; 0: from the heap
    std::shared_ptr<void> lease;  // let go of after the memory
    void operator()(float* p) const;
};

// Floats on a cache line, uninitialised. Growing discards the contents; shrinking keeps the memory.
class Buffer {
  public:
    Buffer() = default;
    explicit Buffer(Index size) { reserve(size); }
    Buffer(float* data, Index size, BufferRelease release)
        : data_(data, std::move(release)), capacity_(size) {}
    Buffer(Buffer&& other) noexcept
        : data_(std::move(other.data_)), capacity_(std::exchange(other.capacity_, 0)) {}
    Buffer& operator=(Buffer&& other) noexcept;

    void reserve(Index size);
    float* data() { return data_.get(); }
    const float* data() const { return data_.get(); }

    // Holds `lease` for as long as this memory.
    void attach(std::shared_ptr<void> lease) { data_.get_deleter().lease = std::move(lease); }
    bool mapped() const { return data_.get_deleter().mapped > 0; }
    void drop() const;

  private:
    std::unique_ptr<float[], BufferRelease> data_;
    Index capacity_ = 0;
};

class Tensor {
  public:
    Tensor() = default;
    explicit Tensor(Shape shape) { reset(std::move(shape)); }
    Tensor(Shape shape, Buffer buffer);
    Tensor(const Tensor& other);
    Tensor& operator=(const Tensor& other);
    Tensor(Tensor&& other) noexcept;
    Tensor& operator=(Tensor&& other) noexcept;

    // New shape, undefined contents, memory reused where it is large enough.
    void reset(Shape shape);
    void fill(float value);

    // Whether a Workspace put it in a file; if so, drop() tells the system that its pages are not
    // needed for now. The contents stay.
    bool mapped() const { return buffer_.mapped(); }
    void drop() const { buffer_.drop(); }

    const Shape& shape() const { return shape_; }
    Index order() const { return static_cast<Index>(shape_.size()); }
    Index dim(Index mode) const { return shape_[at(mode)]; }
    Index size() const { return size_; }
    float* data() { return buffer_.data(); }
    const float* data() const { return buffer_.data(); }

  private:
    Shape shape_;
    Index size_ = 0;
    Buffer buffer_;
};

// The mode-n view of a C-order tensor: `outer` matrices of rows x inner, one after the other.
struct Unfolding {
    Index outer, rows, inner;
};
Unfolding unfolding(const Shape& shape, Index mode);

// Copies the block of `size` at `begin` of `source` into the same-sized C-order `block`, and back.
void copy_out(const float* source, const Shape& shape, const Shape& begin, const Shape& size,
              float* block);
void copy_in(const float* block, const Shape& begin, const Shape& size, const Shape& shape,
             float* destination);

}  // namespace nacre
