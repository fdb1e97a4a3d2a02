// Where the samples come from: a tensor that is read block by block and need not fit in memory.
#pragma once

#include <array>
#include <atomic>
#include <string>

#include "nacre/colour_domain.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

class TensorSource {
  public:
    virtual ~TensorSource() = default;

    const Shape& shape() const { return shape_; }

    // Rows of a mode that belong together; blocks begin and end at multiples of it.
    virtual Index granularity(Index /*mode*/) const { return 1; }

    // The block of `size` at `begin` as C-order floats.
    void read(const Shape& begin, const Shape& size, float* block) const;

    // How often the whole has been read so far: values read over values there are.
    double passes() const;

    // Called when sums over the samples came out NaN or infinite: throws std::invalid_argument
    // that names the first sample, in storage order, that is not a usable number.
    [[noreturn]] virtual void throw_invalid() const;

  protected:
    explicit TensorSource(Shape shape) : shape_(std::move(shape)) {}

    virtual void fetch(const Shape& begin, const Shape& size, float* block) const = 0;

  private:
    Shape shape_;
    mutable std::atomic<Index> values_read_{0};
};

// A tensor in memory that someone else owns.
class MemorySource : public TensorSource {
  public:
    MemorySource(const float* data, Shape shape) : TensorSource(std::move(shape)), data_(data) {}
    explicit MemorySource(const Tensor& tensor) : MemorySource(tensor.data(), tensor.shape()) {}

  protected:
    void fetch(const Shape& begin, const Shape& size, float* block) const override;

  private:
    const float* data_;
};

enum class SampleType { kHalf, kFloat };

// A bidirectional texture function as stored: samples (light, view, y, x, channel), C order, half
// or float, owned by the caller. The tensor has the modes (light rows, view, y, x), where light row
// `channels * light + channel` is one colour of one light, in the domain that is asked for.
class BtfSource : public TensorSource {
  public:
    // `drop`: the samples are a shared or read-only mapping of a file, whose pages are to be
    // dropped behind the reader (see drop_pages).
    BtfSource(const void* samples, SampleType type, const std::array<Index, 5>& shape,
              bool drop = false, ColourDomain domain = ColourDomain::kLinear);
    ~BtfSource() override;

    Index channels() const { return dims_[4]; }
    Index granularity(Index mode) const override { return mode == 0 ? channels() : 1; }
    [[noreturn]] void throw_invalid() const override;

  protected:
    void fetch(const Shape& begin, const Shape& size, float* block) const override;

  private:
    void drop() const;

    const void* samples_;
    SampleType type_;
    std::array<Index, 5> dims_;
    bool drop_;
    ColourDomain domain_;
    mutable std::atomic<std::size_t> undropped_{0};  // bytes read since pages were last dropped
};

}  // namespace nacre
