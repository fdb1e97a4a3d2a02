// The largest of many coefficients: hard thresholding.
#pragma once

#include <cstdint>
#include <vector>

#include "nacre/tensor.hpp"

namespace nacre {

struct Coefficient {
    std::uint32_t position;  // in C order
    float value;
};

// The `count` of largest magnitude, in no order; the lower position among equal ones. Zeros are
// none.
void largest(const float* values, Index size, Index count, std::vector<Coefficient>& found);

// Larger first, the lower position first among equal ones.
void sort_by_importance(std::vector<Coefficient>& coefficients);

// Sum of squares, added in double.
double energy(const std::vector<Coefficient>& coefficients);

}  // namespace nacre
