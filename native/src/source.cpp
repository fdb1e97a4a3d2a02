#include "nacre/source.hpp"

#include <cmath>

#include "nacre/errors.hpp"
#include "nacre/pages.hpp"
#include "nacre/unpack.hpp"

namespace nacre {

namespace {

// Beyond this, squares leave the range of single precision.
constexpr float kLargest = 1e15f;

// Pages are dropped all at once after so many bytes: a call for each block would cost more.
constexpr std::size_t kDropBytes = std::size_t{16} << 20;

bool usable(float value) { return std::abs(value) <= kLargest; }  // false for NaN

std::string fault(float value) {
    if (std::isnan(value)) return "NaN";
    if (std::isinf(value)) return value > 0 ? "infinity" : "-infinity";
    std::ostringstream text;
    text << value;
    return text.str();
}

}  // namespace

void TensorSource::read(const Shape& begin, const Shape& size, float* block) const {
    fetch(begin, size, block);
    values_read_.fetch_add(product(size), std::memory_order_relaxed);
}

double TensorSource::passes() const {
    return static_cast<double>(values_read_.load()) / static_cast<double>(product(shape_));
}

void TensorSource::throw_invalid() const {
    throw std::invalid_argument("samples: expected finite numbers below 1e15 in magnitude");
}

void MemorySource::fetch(const Shape& begin, const Shape& size, float* block) const {
    copy_out(data_, shape(), begin, size, block);
}

BtfSource::BtfSource(const void* samples, SampleType type, const std::array<Index, 5>& shape,
                     bool drop, ColourDomain domain)
    : TensorSource({shape[0] * shape[4], shape[1], shape[2], shape[3]}),
      samples_(samples),
      type_(type),
      dims_(shape),
      drop_(drop),
      domain_(domain) {
    static constexpr const char* kNames[] = {"light", "view", "y", "x", "channel"};
    for (std::size_t n = 0; n < 5; ++n) {
        require(shape[n] > 0, "samples: expected at least one sample along ", kNames[n], ", got ",
                shape[n]);
    }
    require(domain == ColourDomain::kLinear || shape[4] == 3,
            "domain: expected 3 channels, red, green and blue, for log, got ", shape[4]);
}

BtfSource::~BtfSource() {
    if (drop_) drop();
}

void BtfSource::drop() const {
    drop_pages(samples_, at(product(shape())) * (type_ == SampleType::kHalf ? 2 : 4));
}

void BtfSource::fetch(const Shape& begin, const Shape& size, float* block) const {
    const auto [lights, views, height, width, channels] = dims_;
    const bool whole_rows = size[3] == width;
    const Index run = whole_rows ? size[2] * width : size[3];  // pixels next to each other
    const Index runs = whole_rows ? 1 : size[2];
    const Index row_stride = size[1] * size[2] * size[3];  // between light rows of the block
    for (Index l = 0; l < size[0] / channels; ++l) {
        for (Index v = 0; v < size[1]; ++v) {
            const Index image = (begin[0] / channels + l) * views + begin[1] + v;
            for (Index r = 0; r < runs; ++r) {
                const Index pixel = (image * height + begin[2] + r) * width + begin[3];
                float* rows = block + l * channels * row_stride + (v * size[2] + r) * size[3];
                unpack(samples_, type_, pixel * channels, run, channels, rows, row_stride);
                if (domain_ == ColourDomain::kLog) to_log(rows, run, row_stride);
            }
        }
    }
    if (!drop_) return;
    const std::size_t bytes = at(product(size)) * (type_ == SampleType::kHalf ? 2 : 4);
    if (undropped_.fetch_add(bytes) + bytes < kDropBytes) return;
    undropped_ = 0;
    drop();
}

void BtfSource::throw_invalid() const {
    const Index pixels = dims_[0] * dims_[1] * dims_[2] * dims_[3], channels = dims_[4];
    std::vector<float> values(at(dims_[3] * channels));
    for (Index pixel = 0; pixel < pixels; pixel += dims_[3]) {
        unpack(samples_, type_, pixel * channels, dims_[3] * channels, 1, values.data(), 0);
        for (std::size_t i = 0; i < values.size(); ++i) {
            if (usable(values[i])) continue;
            Index rest = pixel * channels + static_cast<Index>(i);
            Index index[5];
            for (int n = 4; n >= 0; --n) {
                index[n] = rest % dims_[at(n)];
                rest /= dims_[at(n)];
            }
            require(false, "samples: expected finite numbers below 1e15 in magnitude, got ",
                    fault(values[i]), " at light ", index[0], ", view ", index[1], ", y ", index[2],
                    ", x ", index[3], ", channel ", index[4]);
        }
    }
    TensorSource::throw_invalid();
}

}  // namespace nacre
