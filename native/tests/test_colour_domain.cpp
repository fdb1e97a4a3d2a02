// Conversion while reading, against the formulas in double precision.
#include <limits>

#include "check.hpp"
#include "nacre/colour_domain.hpp"
#include "nacre/source.hpp"

using namespace nacre;

namespace {

struct Log {
    double values[3];
};

Log expected(double r, double g, double b) {
    const double y = std::max(0.299 * r + 0.587 * g + 0.114 * b, 0.0) + 0.01;
    const double u = -0.14713 * r - 0.28886 * g + 0.436 * b;
    const double v = 0.615 * r - 0.51499 * g - 0.10001 * b;
    return {{std::log(y), u / y, v / y}};
}

// Colours from far below the offset to far above white, negative ones too, in planes with a gap.
void conversion() {
    constexpr Index kPixels = 4003, kStride = 4010;
    Random random(3);
    std::vector<float> planes(3 * kStride, -7.0f);
    for (Index i = 0; i < kPixels; ++i) {
        const double scale = std::pow(10.0, 12 * random.uniform() - 8);
        for (Index c = 0; c < 3; ++c) {
            planes[at(c * kStride + i)] = static_cast<float>(scale * (random.uniform() - 0.1));
        }
    }
    planes[0] = planes[kStride] = planes[2 * kStride] = 0.0f;
    const std::vector<float> linear = planes;
    to_log(planes.data(), kPixels, kStride);
    for (Index i = 0; i < kPixels; ++i) {
        const Log log =
            expected(linear[at(i)], linear[at(kStride + i)], linear[at(2 * kStride + i)]);
        for (Index c = 0; c < 3; ++c) {
            const double value = log.values[c];
            CHECK_NEAR(planes[at(c * kStride + i)], value, 1e-5 * std::max(1.0, std::abs(value)));
        }
    }
    for (Index i = kPixels; i < kStride; ++i) CHECK(planes[at(i)] == -7.0f);
}

void numbers_that_are_none() {
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
          -std::numeric_limits<float>::infinity()}) {
        for (int channel = 0; channel < 3; ++channel) {
            float pixel[3] = {0.2f, 0.3f, 0.4f};
            pixel[channel] = bad;
            to_log(pixel, 1, 1);
            CHECK(!std::isfinite(pixel[0] + pixel[1] + pixel[2]));
        }
    }
}

// Blocks that begin and end anywhere, of whole rows of texels and of parts of them.
void reading() {
    const std::array<Index, 5> dims{2, 3, 4, 5, 3};
    std::vector<float> samples(2 * 3 * 4 * 5 * 3);
    Random random(4);
    for (float& value : samples) value = static_cast<float>(random.uniform());
    const BtfSource source(samples.data(), SampleType::kFloat, dims, false, ColourDomain::kLog);
    const std::vector<std::pair<Shape, Shape>> blocks{{{0, 0, 0, 0}, {6, 3, 4, 5}},
                                                      {{3, 1, 2, 1}, {3, 2, 2, 3}}};
    for (const auto& [begin, size] : blocks) {
        std::vector<float> block(at(product(size)));
        source.read(begin, size, block.data());
        std::size_t place = 0;
        dense::for_each(size, [&](const Shape& index) {
            const Index row = begin[0] + index[0];
            const float* pixel = samples.data();
            pixel += (((row / 3 * 3 + begin[1] + index[1]) * 4 + begin[2] + index[2]) * 5 +
                      begin[3] + index[3]) *
                     3;
            const Log log = expected(pixel[0], pixel[1], pixel[2]);
            CHECK_NEAR(block[place++], log.values[row % 3], 2e-6);
        });
    }
    CHECK(message_of([&] {
              BtfSource(samples.data(), SampleType::kFloat, {2, 3, 4, 5, 2}, false,
                        ColourDomain::kLog);
          }) == "domain: expected 3 channels, red, green and blue, for log, got 2");
}

}  // namespace

int main() {
    conversion();
    numbers_that_are_none();
    reading();
    CHECK(colour_domain("linear") == ColourDomain::kLinear);
    CHECK(colour_domain("log") == ColourDomain::kLog);
    CHECK(message_of([] { colour_domain("lab"); }) == "domain: expected linear or log, got lab");
    std::puts("ok");
}
