// Passes over a TensorSource. Each reads every block once, in blocks that stay in a core's cache,
// so no float copy of the samples is ever made.
#pragma once

#include <vector>

#include "nacre/executor.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"
#include "nacre/workspace.hpp"

namespace nacre {

// ufn(B) ufn(B)^T, both triangles, of B = A x_k U_k^T over every mode k that has a basis (`mode`
// has none). B is not stored. The trace is ||B||^2; throws through source.throw_invalid() if that
// is not finite.
MatrixD gram(Executor& executor, const TensorSource& source, Index mode, const Bases& bases = {});

// A x_k U_k^T over every mode k that has a basis. `order` says which mode of A comes where in the
// result; empty: as they are. A mode without a basis is what the work is divided by.
Tensor project(Executor& executor, const TensorSource& source, const Bases& bases,
               const std::vector<Index>& order = {}, const Workspace& workspace = {});

// A x_mode U^T, mode `first` in front.
Tensor project(Executor& executor, const TensorSource& source, Index mode, const MatrixF& basis,
               Index first = 0, const Workspace& workspace = {});

// The whole tensor, mode `first` in front.
Tensor load(Executor& executor, const TensorSource& source, Index first = 0,
            const Workspace& workspace = {});

// The tensor with mode `first` moved to the front.
Shape front_shape(const Shape& shape, Index first);
Tensor move_to_front(Executor& executor, const Tensor& tensor, Index first);

}  // namespace nacre
