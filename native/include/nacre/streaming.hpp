// Passes over a TensorSource. Each reads every block once, in blocks that stay in a core's cache,
// so no float copy of the samples is ever made.
#pragma once

#include <vector>

#include "nacre/executor.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// ufn(A) ufn(A)^T, both triangles. Its trace is ||A||^2; throws through source.throw_invalid() if
// that is not finite.
MatrixD gram(Executor& executor, const TensorSource& source, Index mode);

// A x_mode U^T in memory. `first` is the mode that comes first in the result, the others keeping
// their order; 0 keeps the order of the source.
Tensor project(Executor& executor, const TensorSource& source, Index mode, const MatrixF& basis,
               Index first = 0);

// A x_n U_n^T over every n with a basis, in memory; bases[lead] must be null and its rows are what
// the work is divided by.
Tensor project_others(Executor& executor, const TensorSource& source, Index lead,
                      const std::vector<const MatrixF*>& bases);

// The whole tensor in memory, `first` mode first.
Tensor load(Executor& executor, const TensorSource& source, Index first = 0);

// The tensor with mode `first` moved to the front.
Shape front_shape(const Shape& shape, Index first);
Tensor move_to_front(Executor& executor, const Tensor& tensor, Index first);

}  // namespace nacre
