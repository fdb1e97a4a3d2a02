// Ensembles of orthonormal dictionaries: training and sparse coding of SparseBTF (Kavoosighafi,
// Frisvad, Hajisharif, Unger and Miandji 2023, Sections 3.2 and 3.3).
//
// A patch X is coded as X = S x_1 U_1 ... x_N U_N (Eq. 1), where the U_n are the orthonormal
// matrices of one dictionary of the ensemble, one a mode, and S has few coefficients.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/patches.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// A square orthonormal matrix for each mode; atoms are columns.
using Dictionary = std::vector<MatrixF>;
using Ensemble = std::vector<Dictionary>;

// The largest entry of |U^T U - I| of all matrices.
double orthonormality_error(const Ensemble& ensemble);

struct TrainingOptions {
    Index dictionaries = 8;  // K
    Index sparsity = 256;    // tau_l, coefficients of each patch
    int sweeps = 30;
    double tolerance = 1e-3;  // stop when the objective falls by less than this part of itself
    // The dictionary of each patch is chosen anew in every so many sweeps; in the others, which
    // take less time, only the dictionaries are fitted.
    int reassign = 1;
    std::uint64_t seed = 0;
};

struct Training {
    Ensemble ensemble;
    std::vector<std::uint32_t> members;  // the dictionary of each patch
    // The objective (Eq. 2a) over the squared norm of all patches at the begin of each sweep, and
    // at the end. Never rising, but for the rounding of single precision products.
    std::vector<double> errors;
    std::vector<double> orthonormality;  // after each sweep
    std::vector<Index> reseeded;         // dictionaries that no patch had chosen, in each sweep
    double squared_norm = 0;
    int sweeps = 0;
};

// Called with the state after each sweep that another may follow.
using TrainingCheckpoint = std::function<void(const Training&)>;

// Minimises Eq. 2a subject to Eqs. 2b to 2d. A sweep fits every mode in turn: each patch is
// projected on its dictionary and the largest coefficients kept (the best S for these U), and the
// mode's matrices are the solutions of the orthogonal Procrustes problem (the best U_n for these S
// and the other matrices). The first mode's turn also chooses each patch's dictionary. None of the
// three can raise the objective.
//
// What is in memory is, besides the ensemble, three patches a thread and the coefficients of a few
// patches: patches are read anew in each pass. `start` is a state that `checkpoint` was given; the
// training then ends with the bits of one that was not interrupted.
Training train(Executor& executor, const Patches& patches, const TrainingOptions& options,
               const Training* start = nullptr, const TrainingCheckpoint& checkpoint = {});

struct SparseCode {
    Index sparsity = 0;
    std::vector<std::uint32_t> positions;  // patches x sparsity, in C order of the coefficients
    std::vector<float> values;             // patches x sparsity, larger magnitude first, then zeros
    std::vector<std::uint32_t> counts;     // coefficients that are not zero
    std::vector<std::uint32_t> members;    // dictionary
    std::vector<double> errors;            // squared error of each patch
};

// Projects each patch on every dictionary (Eq. 3) and keeps its largest coefficients until there
// are `sparsity` or the mean squared error is `error`. The sparsest dictionary is chosen, among
// equals the one of least error.
SparseCode code(Executor& executor, const Patches& patches, const Ensemble& ensemble,
                Index sparsity, double error = 0);

}  // namespace nacre
