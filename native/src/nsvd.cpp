#include "nacre/nsvd.hpp"

#include <algorithm>

#include "nacre/errors.hpp"
#include "nacre/gram.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/streaming.hpp"

namespace nacre {

namespace {

// The bases in use but those of two modes.
Bases all_but(const std::vector<MatrixF>& bases, Index mode, Index other = -1) {
    Bases list(bases.size(), nullptr);
    for (std::size_t n = 0; n < bases.size(); ++n) {
        const Index index = static_cast<Index>(n);
        if (index != mode && index != other && bases[n].size() > 0) list[n] = &bases[n];
    }
    return list;
}

class Fit {
  public:
    Fit(Executor& executor, const TensorSource& source, const NsvdOptions& options);
    Tucker run();

  private:
    Index rank(Index mode) const { return options_.ranks[at(mode)]; }
    double relative(double kept) const;

    void start();
    bool converged() const;
    bool iterate();
    double update(Index mode, const MatrixD& covariance, MatrixF& basis) const;
    double update_others(std::vector<MatrixF>& bases);
    double update_lead(std::vector<MatrixF>& bases, Tensor& core);

    Executor& executor_;
    const TensorSource& source_;
    const NsvdOptions& options_;
    std::vector<Index> modes_;  // those with a rank
    Index lead_ = 0;            // the first of them
    // Two ranks, other modes left alone: each basis is from one pass, in which the tensor projected
    // on the other one lives block by block.
    bool streamed_ = false;
    Tucker result_;
    Tensor projected_;  // A x_lead U^T, between the start and the first iteration
};

Fit::Fit(Executor& executor, const TensorSource& source, const NsvdOptions& options)
    : executor_(executor), source_(source), options_(options) {
    const Index order = static_cast<Index>(source.shape().size());
    for (Index n = 0; n < order; ++n) {
        if (rank(n) > 0) modes_.push_back(n);
    }
    if (!modes_.empty()) lead_ = modes_[0];
    streamed_ = modes_.size() == 2 && order > 2;
    result_.bases.resize(at(order));
}

double Fit::relative(double kept) const {
    if (result_.squared_norm <= 0) return 0;
    return std::max(0.0, 1 - kept / result_.squared_norm);
}

// The truncated HOSVD, sequentially: each basis from the tensor truncated so far.
void Fit::start() {
    executor_.stage(0, 0.3, "N-SVD: covariance");
    const MatrixD covariance = gram(executor_, source_, lead_);
    result_.squared_norm = covariance.trace();
    std::vector<MatrixF>& bases = result_.bases;
    bases[at(lead_)] = leading_basis(covariance, rank(lead_));
    executor_.stage(0.3, 0.4, "N-SVD: projection");
    if (streamed_) {
        const Index other = modes_[1];
        const MatrixD rest = gram(executor_, source_, other, all_but(bases, other));
        bases[at(other)] = leading_basis(rest, rank(other));
        return;
    }
    projected_ = project(executor_, source_, lead_, bases[at(lead_)], 0, options_.workspace);
    const Tensor* truncated = &projected_;
    Tensor next;
    for (std::size_t k = 1; k < modes_.size(); ++k) {
        const Index n = modes_[k];
        const MemorySource all(*truncated);
        bases[at(n)] = leading_basis(gram(executor_, all, n), rank(n));
        next = project(executor_, all, n, bases[at(n)], 0, options_.workspace);
        truncated = &next;
    }
    result_.core = modes_.size() > 1 ? std::move(next) : std::move(projected_);
}

bool Fit::converged() const {
    const std::vector<double>& errors = result_.errors;
    if (errors.size() < 2) return false;
    const double last = errors[errors.size() - 2];
    return last - errors.back() <= options_.tolerance * last;
}

// One iteration of alternating least squares. False, and no change, if it lowers the error by too
// little: for then the others' bases do not change, and the lead mode's is the best for them
// already. It cannot raise the error, but rounding at its end can.
bool Fit::iterate() {
    const double step = 0.6 / options_.iterations, begin = 0.4 + step * result_.iterations;
    const std::string message = "N-SVD: iteration " + std::to_string(result_.iterations + 1);
    const bool first = result_.iterations == 0;
    const double last = first ? 2 : result_.errors.back();  // no error is above 1
    std::vector<MatrixF> bases = result_.bases;
    // In a streamed fit, the start has found the other mode's basis from the lead mode's.
    if (!streamed_ || !first) {
        executor_.stage(begin, begin + 0.4 * step, message);
        const double error = update_others(bases);
        if (!first && last - error <= options_.tolerance * last) return false;
    }
    executor_.stage(begin + 0.4 * step, begin + step, message);
    Tensor core;
    const double error = update_lead(bases, core);
    if (error >= last) return false;
    result_.bases = std::move(bases);
    result_.core = std::move(core);
    result_.errors.push_back(error);
    ++result_.iterations;
    return true;
}

// A basis from the covariance of the tensor projected on the others; the error then.
double Fit::update(Index mode, const MatrixD& covariance, MatrixF& basis) const {
    basis = leading_basis(covariance, rank(mode));
    const MatrixD u = basis.cast<double>();
    return relative((u.transpose() * covariance * u).trace());
}

double Fit::update_others(std::vector<MatrixF>& bases) {
    if (streamed_) {
        const Index n = modes_[1];
        return update(n, gram(executor_, source_, n, all_but(bases, n)), bases[at(n)]);
    }
    if (projected_.size() == 0) {
        projected_ = project(executor_, source_, lead_, bases[at(lead_)], 0, options_.workspace);
    }
    const MemorySource projected(projected_);
    double error = 0;
    for (Index n : modes_) {
        if (n == lead_) continue;
        error = update(n, gram(executor_, projected, n, all_but(bases, n, lead_)), bases[at(n)]);
        projected_.drop();
    }
    projected_ = Tensor();
    return error;
}

double Fit::update_lead(std::vector<MatrixF>& bases, Tensor& core) {
    MatrixF& basis = bases[at(lead_)];
    if (streamed_) {
        return update(lead_, gram(executor_, source_, lead_, all_but(bases, lead_)), basis);
    }
    const Tensor stored =
        project(executor_, source_, all_but(bases, lead_), {}, options_.workspace);
    const MemorySource rest(stored);
    basis = leading_basis(gram(executor_, rest, lead_), rank(lead_));
    core = project(executor_, rest, lead_, basis, 0, options_.workspace);
    return relative(squared_norm(executor_, core));
}

Tucker Fit::run() {
    if (options_.start) {
        result_ = *options_.start;
        if (result_.iterations == 0) result_.errors.clear();
    } else if (modes_.empty()) {
        result_.core = load(executor_, source_, 0, options_.workspace);
        result_.squared_norm = squared_norm(executor_, result_.core);
    } else {
        start();
    }
    while (modes_.size() > 1 && result_.iterations < options_.iterations && !converged()) {
        if (!iterate()) break;
        if (options_.checkpoint) options_.checkpoint(result_);
    }
    if (streamed_ && options_.core) {
        executor_.stage(1, 1, "N-SVD: core");
        result_.core =
            project(executor_, source_, all_but(result_.bases, -1), {}, options_.workspace);
    }
    if (result_.errors.empty()) {
        result_.errors.push_back(relative(squared_norm(executor_, result_.core)));
    }
    executor_.stage(1, 1, "N-SVD: done");
    return std::move(result_);
}

}  // namespace

Tucker nsvd(Executor& executor, const TensorSource& source, const NsvdOptions& options) {
    return Fit(executor, source, options).run();
}

}  // namespace nacre
