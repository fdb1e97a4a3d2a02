// Colours as they are fitted: linear, or the logarithm of luminance with chroma relative to it, in
// which equal errors look about equal. As colour model 11 of UBO2014's files, but for the offset.
#pragma once

#include <string>

#include "nacre/tensor.hpp"

namespace nacre {

enum class ColourDomain {
    kLinear,
    kLog,  // log(Y + offset), U / (Y + offset), V / (Y + offset) of a pixel's Y >= 0, U, V
};

// Luminance of a hundredth of white: below it lightness (CIE L*) falls linearly, and measured
// values are mostly noise, which a logarithm would enlarge.
inline constexpr float kLogOffset = 0.01f;

// "linear" or "log"; throws std::invalid_argument for another name.
ColourDomain colour_domain(const std::string& name);

// Planes of linear red, green and blue, `stride` apart, to kLog in place. Values that are not
// finite do not become finite.
void to_log(float* planes, Index pixels, Index stride);

}  // namespace nacre
