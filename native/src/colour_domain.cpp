#include "nacre/colour_domain.hpp"

#include <bit>
#include <cmath>
#include <cstdint>

#include "nacre/errors.hpp"

namespace nacre {

namespace {

// The natural logarithm of a normal number, to the last bit or two; a loop over it is vectorised.
// x = 2^k (1 + f) with sqrt(1/2) < 1 + f < sqrt(2); then log(1 + f) by the series of FreeBSD's
// logf.
inline float log_of(float x) {
    constexpr std::uint32_t kRootHalf = 0x3f3504f3;
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(x) + (0x3f800000 - kRootHalf);
    const float k = static_cast<float>(static_cast<std::int32_t>(bits >> 23) - 127);
    const float f = std::bit_cast<float>((bits & 0x007fffff) + kRootHalf) - 1.0f;
    const float s = f / (2.0f + f), z = s * s, w = z * z;
    const float series =
        z * (0xaaaaaa.0p-24f + w * 0x91e9ee.0p-25f) + w * (0xccce13.0p-25f + w * 0xf89e26.0p-26f);
    const float half = 0.5f * f * f;
    return s * (half + series) + k * 9.0580006145e-06f - half + f + k * 6.9313812256e-01f;
}

}  // namespace

ColourDomain colour_domain(const std::string& name) {
    if (name == "linear") return ColourDomain::kLinear;
    require(name == "log", "domain: expected linear or log, got ", name);
    return ColourDomain::kLog;
}

void to_log(float* planes, Index pixels, Index stride) {
    float* __restrict red = planes;
    float* __restrict green = planes + stride;
    float* __restrict blue = planes + 2 * stride;
    for (Index i = 0; i < pixels; ++i) {
        const float r = red[i], g = green[i], b = blue[i];
        const float luminance = 0.299f * r + 0.587f * g + 0.114f * b;
        // The larger of it and 0, without a branch; NaN stays NaN.
        const float y = 0.5f * (luminance + std::abs(luminance)) + kLogOffset;
        const float scale = 1.0f / y;
        red[i] = log_of(y);
        green[i] = (-0.14713f * r - 0.28886f * g + 0.436f * b) * scale;
        blue[i] = (0.615f * r - 0.51499f * g - 0.10001f * b) * scale;
    }
}

}  // namespace nacre
