// Kronecker products of a few short rows, one factor after the other.
#pragma once

#include "nacre/tensor.hpp"

namespace nacre {

// weights (size) becomes its product with `factors` (count), the latter fastest; in place.
inline void kronecker(float* weights, Index size, const float* factors, Index count) {
    for (Index i = size; i-- > 0;) {
        const float w = weights[i];
        for (Index r = count; r-- > 0;) weights[i * count + r] = w * factors[r];
    }
}

}  // namespace nacre
