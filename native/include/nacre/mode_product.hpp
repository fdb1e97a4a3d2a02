// Mode-n products, A x_n U and A x_n U^T (De Lathauwer et al. 2000, Eq. 2 of the K-CTA paper), and
// the Frobenius norm.
#pragma once

#include <vector>

#include "nacre/blas.hpp"
#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// The basis U of a mode is I x R. kTranspose takes I rows to R (projection, A x_n U^T), kNone takes
// R rows to I (expansion, A x_n U).
//
// The view `in` is outer x (rows) x inner; `out` is outer x (new rows) x inner. On one thread.
void mode_product(const float* in, const Unfolding& view, const MatrixF& basis, Op op, float* out);

// A x_n U^T where only some rows of U and as many of A are at hand, to be added up: `basis` are
// view.rows rows of `rank` columns; `add` for all parts but the first.
void contract(const float* in, const Unfolding& view, const float* basis, Index rank, bool add,
              float* out);

// mode_product over all workers. `out` must not be `in`.
void mode_product(Executor& executor, const Tensor& in, Index mode, const MatrixF& basis, Op op,
                  Tensor& out);

// One basis a mode; null leaves the mode alone.
using Bases = std::vector<const MatrixF*>;

// The modes that have a basis, in the order that takes the fewest operations: from r to q rows, by
// falling 1/q - 1/r. (Two neighbours a, b take q_a + (q_a / r_a) q_b operations an element, or the
// same with a and b swapped.)
std::vector<Index> product_order(const Bases& bases, Op op);

// A x_n U_n^T (or U_n) over every mode n with a basis. Uses `scratch` for what lies between; `out`
// may be neither.
void multi_mode_product(Executor& executor, const Tensor& in, const Bases& bases, Op op,
                        Tensor& out, Tensor& scratch);

// Sum of squares, added in double.
double squared_norm(Executor& executor, const Tensor& tensor);
double squared_norm(const float* values, Index size);

}  // namespace nacre
