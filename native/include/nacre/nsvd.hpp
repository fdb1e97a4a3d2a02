// N-SVD: the locally best Tucker approximation of given ranks (De Lathauwer et al. 2000; Section
// 3.2 of the K-CTA paper), by truncated HOSVD and alternating least squares.
#pragma once

#include <functional>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/source.hpp"
#include "nacre/tensor.hpp"
#include "nacre/workspace.hpp"

namespace nacre {

struct Tucker {
    Tensor core;
    std::vector<MatrixF> bases;  // I x R, orthonormal columns; empty for modes left alone
    double squared_norm = 0;     // ||A||^2
    // ||A - approximation||^2 / ||A||^2 after each iteration; that of the start if there is none
    std::vector<double> errors;
    int iterations = 0;
};

struct NsvdOptions {
    std::vector<Index> ranks;  // of each mode; 0 leaves a mode as it is, without a basis
    int iterations = 20;       // 0: the truncated HOSVD alone, each mode after the one before
    double tolerance = 1e-4;   // stop when the error falls by less than this part of itself
    // Whether the core is wanted too, where it would take a pass of its own.
    bool core = true;
    Workspace workspace = {};  // for the large tensors
    // Goes on after the last iteration of `start`, as given to `checkpoint`, which is called after
    // each: the result has the same bits as without the break.
    const Tucker* start = nullptr;
    std::function<void(const Tucker&)> checkpoint = {};
};

// Samples need not fit in memory. Passes over them: two for the start, one for the first iteration,
// two for each further one; the last may end halfway, when it finds nothing to gain. With two ranks
// and other modes left alone, nothing large is stored, for one pass more in the end.
Tucker nsvd(Executor& executor, const TensorSource& source, const NsvdOptions& options);

}  // namespace nacre
