#include <cstring>

#include "check.hpp"
#include "nacre/errors.hpp"
#include "nacre/unpack.hpp"

using namespace nacre;

namespace {

// The definition of a half float.
double half_value(std::uint16_t half) {
    const int exponent = half >> 10 & 31, mantissa = half & 1023;
    const double sign = half & 0x8000 ? -1 : 1;
    if (exponent == 31) return mantissa ? NAN : sign * HUGE_VAL;
    if (exponent == 0) return sign * std::ldexp(mantissa, -24);
    return sign * std::ldexp(1024 + mantissa, exponent - 25);
}

bool same(float a, double b) { return std::isnan(b) ? std::isnan(a) : a == b; }

}  // namespace

int main() {
    std::vector<std::uint16_t> halves(65536);
    for (std::size_t i = 0; i < halves.size(); ++i) halves[i] = static_cast<std::uint16_t>(i);
    std::vector<float> floats(halves.size());
    for (std::size_t i = 0; i < halves.size(); ++i) {
        floats[i] = half_to_float(halves[i]);
        CHECK(same(floats[i], half_value(halves[i])));
    }
    // Any number of channels and pixels, from any start; vector and plain paths alike.
    for (Index channels : {1, 2, 3, 4}) {
        for (Index pixels : {1, 7, 8, 9, 31, 64, 1003}) {
            for (Index first : {Index{0}, Index{15000}, Index{65536} - pixels * channels}) {
                for (bool half : {true, false}) {
                    const Index stride = pixels + 5;
                    std::vector<float> planes(static_cast<std::size_t>(channels * stride), -1);
                    unpack(half ? static_cast<const void*>(halves.data()) : floats.data(),
                           half ? SampleType::kHalf : SampleType::kFloat, first, pixels, channels,
                           planes.data(), stride);
                    for (Index c = 0; c < channels; ++c) {
                        for (Index p = 0; p < stride; ++p) {
                            const float value = planes[static_cast<std::size_t>(c * stride + p)];
                            if (p >= pixels) {
                                CHECK(value == -1);
                            } else {
                                const Index from = first + p * channels + c;
                                CHECK(same(value, half_value(static_cast<std::uint16_t>(from))));
                            }
                        }
                    }
                }
            }
        }
    }
    // A bad sample is named by its index, the first in storage order.
    std::vector<float> samples(2 * 3 * 4 * 5 * 3, 1.0f);
    const BtfSource source(samples.data(), SampleType::kFloat, {2, 3, 4, 5, 3});
    CHECK(source.shape() == Shape({6, 3, 4, 5}));
    samples[(((1 * 3 + 2) * 4 + 3) * 5 + 4) * 3 + 2] = INFINITY;
    samples[(((1 * 3 + 2) * 4 + 0) * 5 + 1) * 3 + 0] = NAN;
    CHECK(message_of([&] { source.throw_invalid(); }) ==
          "samples: expected finite numbers below 1e15 in magnitude, got NaN at light 1, view 2, "
          "y 0, x 1, channel 0");
    CHECK(message_of([&] { BtfSource(samples.data(), SampleType::kFloat, {2, 0, 4, 5, 3}); }) ==
          "samples: expected at least one sample along view, got 0");
    std::puts("ok");
}
