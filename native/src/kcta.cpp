#include "nacre/kcta.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "nacre/errors.hpp"
#include "nacre/gram.hpp"
#include "nacre/kmeans.hpp"
#include "nacre/mode_product.hpp"
#include "nacre/nsvd.hpp"
#include "nacre/streaming.hpp"

namespace nacre {

namespace {

constexpr Index kColumns = 4096;  // of the mode-m unfolding, in one task
constexpr int kFirstSweeps = 3;   // of the N-SVD of each first cluster
constexpr int kSweeps = 1;        // of that of an update, which starts from the last result
constexpr double kSweepTolerance = 1e-5;

void validate(const Shape& shape, const KctaOptions& options) {
    const Index order = static_cast<Index>(shape.size());
    require(options.clustered >= 0 && options.clustered < order,
            "clustered: expected a mode from 0 to ", order - 1, ", got ", options.clustered);
    const Index items = shape[at(options.clustered)];
    require(static_cast<Index>(options.ranks.size()) == order, "ranks: expected ", order,
            " numbers, got ", options.ranks.size());
    for (Index n = 0; n < order; ++n) {
        require(options.ranks[at(n)] >= 1 && options.ranks[at(n)] <= shape[at(n)],
                "ranks: expected 1 to ", shape[at(n)], " for mode ", n, ", got ",
                options.ranks[at(n)]);
    }
    require(options.clusters >= 1 && options.clusters <= items, "clusters: expected 1 to ", items,
            " (the rows of the clustered mode), got ", options.clusters);
    require(options.mixtures >= 1 && options.mixtures <= options.clusters,
            "mixtures: expected 1 to ", options.clusters, " (the clusters), got ",
            options.mixtures);
    std::vector<bool> seen(shape.size(), false);
    for (Index mode : options.global_modes) {
        require(mode >= 0 && mode < order && mode != options.clustered && !seen[at(mode)],
                "global_modes: expected distinct modes from 0 to ", order - 1,
                " other than the clustered mode ", options.clustered, ", got ", mode);
        seen[at(mode)] = true;
    }
    require(options.parameters.rows() == items, "directions: expected ", items,
            " rows (the clustered mode's), got ", options.parameters.rows());
    require(options.parameters.allFinite(), "directions: expected finite numbers");
    require(options.iterations >= 0, "iterations: expected 0 or more, got ", options.iterations);
    require(options.tolerance >= 0, "tolerance: expected 0 or more, got ", options.tolerance);
}

struct Cluster {
    std::vector<Index> members;  // ascending; Eq. 21
    MatrixF mixing;              // members x R_m: the nonzero rows of U_m,c
    std::vector<MatrixF> bases;  // of the other modes, empty where global
    Tensor core;                 // R_m first
};

// The fit on the reduced tensor A_G (Eq. 23), clustered mode first: items x (the other modes).
class Fit {
  public:
    Fit(Executor& executor, Tensor tensor, const std::vector<Index>& ranks,
        const KctaOptions& options, double total_energy);

    void start();
    void iterate();

    const std::vector<Cluster>& clusters() const { return clusters_; }
    const std::vector<double>& errors() const { return errors_; }
    int iterations() const { return iterations_; }

  private:
    void project();
    double item_error(Index item, const double* coefficients) const;
    double relative_error() const;
    void assign(Membership membership);
    void split_empty();
    void update(Index c, int sweeps);
    void residual(Index c);
    void expand(Index c);
    double core_norms() const;

    Executor& executor_;
    const Tensor tensor_;             // items x others...
    const std::vector<Index> ranks_;  // clustered mode first; 0 for a global mode
    const KctaOptions& options_;
    Index items_, columns_, count_, rank_;
    double total_energy_;  // ||A||^2, before the reduction
    VectorD item_energy_;
    double lost_energy_;  // ||A||^2 - ||A_G||^2

    std::vector<Cluster> clusters_;
    MatrixF mixing_;       // items x (C R): U_m of all clusters, zero where not a member
    Tensor expanded_;      // (C R) x columns: Z_c x_n U_n,c over the other modes
    MatrixD projections_;  // items x (C R)
    MatrixD gram_;         // (C R) x (C R)
    std::vector<double> errors_;
    int iterations_ = 0;

    MemberDecomposition decomposition_;
    Tensor residual_, scratch_, expanded_one_;
};

Fit::Fit(Executor& executor, Tensor tensor, const std::vector<Index>& ranks,
         const KctaOptions& options, double total_energy)
    : executor_(executor),
      tensor_(std::move(tensor)),
      ranks_(ranks),
      options_(options),
      items_(tensor_.dim(0)),
      columns_(tensor_.size() / items_),
      count_(options.clusters),
      rank_(ranks[0]),
      total_energy_(total_energy),
      item_energy_(items_),
      clusters_(at(count_)),
      expanded_({count_ * rank_, columns_}) {
    executor_.parallel_for(items_, [&](Index i, int) {
        item_energy_(i) = squared_norm(tensor_.data() + i * columns_, columns_);
    });
    lost_energy_ = std::max(0.0, total_energy - item_energy_.sum());
    mixing_.setZero(items_, count_ * rank_);
}

// Section 5.1: clusters in the parametric space, then one iteration of CTA.
void Fit::start() {
    const std::vector<Index> seeds = kmeans(options_.parameters, count_, options_.seed);
    for (Index i = 0; i < items_; ++i) clusters_[at(seeds[at(i)])].members.push_back(i);
    expanded_.fill(0);
    for (Index c = 0; c < count_; ++c) {
        clusters_[at(c)].bases.resize(ranks_.size());
        clusters_[at(c)].mixing.setZero(static_cast<Index>(clusters_[at(c)].members.size()), rank_);
        update(c, kFirstSweeps);
    }
}

void Fit::iterate() {
    std::vector<Cluster> best;
    MatrixF best_mixing;
    double best_norms = 0;
    for (;; ++iterations_) {
        const double share = 1.0 / (options_.iterations + 1);
        executor_.stage(0.5 + 0.5 * share * iterations_, 0.5 + 0.5 * share * (iterations_ + 1),
                        "K-CTA: iteration " + std::to_string(iterations_ + 1));
        project();
        const double error = relative_error();
        if (!errors_.empty() && error > errors_.back()) {
            // Section 5.3: the last result again.
            clusters_ = std::move(best);
            mixing_ = std::move(best_mixing);
            break;
        }
        const double last = errors_.empty() ? 2 : errors_.back();  // no error is above 1
        errors_.push_back(error);
        const double norms = core_norms();
        // The norms alone say little where the error is a small part of the energy.
        const bool converged = std::abs(norms - best_norms) <= options_.tolerance * best_norms &&
                               last - error <= options_.tolerance * last;
        if (converged || iterations_ == options_.iterations) break;
        best = clusters_;
        best_mixing = mixing_;
        best_norms = norms;

        assign(search_clusters(executor_, projections_.data(), items_, gram_, count_, rank_,
                               options_.mixtures));
        split_empty();
        for (Index c = 0; c < count_; ++c) update(c, kSweeps);
    }
}

// Projections of every item on every cluster and the clusters' Gram matrix. They are the inner
// products of Eqs. 18 and 17, taken with the expanded cores: <A x_n U_n^T, Z> = <A, Z x_n U_n>.
void Fit::project() {
    const Index width = count_ * rank_;
    const Index tasks = (columns_ + kColumns - 1) / kColumns;
    const Index slabs = slab_count(tasks);
    std::vector<MatrixD> partial(at(slabs));
    executor_.parallel_for(slabs, [&](Index slab, int) {
        MatrixF piece(items_ + width, width);
        MatrixD sum = MatrixD::Zero(items_ + width, width);
        for (Index task = slab * tasks / slabs; task < (slab + 1) * tasks / slabs; ++task) {
            const Index first = task * kColumns, count = std::min(kColumns, columns_ - first);
            const float* basis = expanded_.data() + first;
            gemm(Op::kNone, Op::kTranspose, items_, width, count, 1.0f, tensor_.data() + first,
                 columns_, basis, columns_, 0.0f, piece.data(), width);
            gemm(Op::kNone, Op::kTranspose, width, width, count, 1.0f, basis, columns_, basis,
                 columns_, 0.0f, piece.data() + items_ * width, width);
            sum += piece.cast<double>();
        }
        partial[at(slab)] = std::move(sum);
    });
    MatrixD total = partial[0];
    for (Index slab = 1; slab < slabs; ++slab) total += partial[at(slab)];
    projections_ = total.topRows(items_);
    const MatrixD gram = total.bottomRows(width);
    gram_ = 0.5 * (gram + gram.transpose());
}

// ||A<i> - its approximation||^2 in A_G, all in the reduced space.
double Fit::item_error(Index item, const double* coefficients) const {
    const Eigen::Map<const VectorD> u(coefficients, count_ * rank_);
    const double error = item_energy_(item) - 2 * projections_.row(item).dot(u) + u.dot(gram_ * u);
    return std::max(0.0, error);
}

double Fit::relative_error() const {
    if (total_energy_ <= 0) return 0;
    double error = lost_energy_;
    for (Index i = 0; i < items_; ++i) {
        const VectorD u = mixing_.row(i).transpose().cast<double>();
        error += item_error(i, u.data());
    }
    return error / total_energy_;
}

double Fit::core_norms() const {
    double sum = 0;
    for (const Cluster& cluster : clusters_) {
        sum += std::sqrt(squared_norm(cluster.core.data(), cluster.core.size()));
    }
    return sum;
}

void Fit::assign(Membership membership) {
    mixing_.setZero();
    for (Cluster& cluster : clusters_) cluster.members.clear();
    for (Index i = 0; i < items_; ++i) {
        for (Index k = 0; k < options_.mixtures; ++k) {
            const Index entry = i * options_.mixtures + k;
            const Index c = membership.clusters[at(entry)];
            clusters_[at(c)].members.push_back(i);
            for (Index r = 0; r < rank_; ++r) {
                mixing_(i, c * rank_ + r) =
                    static_cast<float>(membership.coefficients[at(entry * rank_ + r)]);
            }
        }
    }
    // Section 4.2.3 now factors the mixing matrix of each cluster into an orthonormal one and a
    // matrix that goes into the core. The update stage replaces both before anyone reads them and
    // the other clusters see only their product, so the factors are not formed here.
}

// Section 5.3: an empty cluster takes over half of the one with the largest error, the members that
// are approximated worst. It starts as its copy, so that nothing changes until it is updated.
void Fit::split_empty() {
    for (Index empty = 0; empty < count_; ++empty) {
        if (!clusters_[at(empty)].members.empty()) continue;
        std::vector<double> errors(at(items_));
        for (Index i = 0; i < items_; ++i) {
            const VectorD u = mixing_.row(i).transpose().cast<double>();
            errors[at(i)] = item_error(i, u.data());
        }
        Index worst = -1;
        double largest = -1;
        for (Index c = 0; c < count_; ++c) {
            const std::vector<Index>& members = clusters_[at(c)].members;
            if (members.size() < 2) continue;
            double sum = 0;
            for (Index i : members) sum += errors[at(i)];
            if (sum > largest) {
                largest = sum;
                worst = c;
            }
        }
        // There is one with two members: K * items >= clusters memberships, and one is empty.
        std::vector<Index> sorted = clusters_[at(worst)].members;
        std::stable_sort(sorted.begin(), sorted.end(),
                         [&](Index a, Index b) { return errors[at(a)] < errors[at(b)]; });
        const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() + 1) / 2);
        clusters_[at(empty)].bases = clusters_[at(worst)].bases;
        clusters_[at(empty)].members.assign(middle, sorted.end());
        clusters_[at(worst)].members.assign(sorted.begin(), middle);
        std::sort(clusters_[at(empty)].members.begin(), clusters_[at(empty)].members.end());
        std::sort(clusters_[at(worst)].members.begin(), clusters_[at(worst)].members.end());
        for (Index i : clusters_[at(empty)].members) {
            mixing_.block(i, empty * rank_, 1, rank_) = mixing_.block(i, worst * rank_, 1, rank_);
            mixing_.block(i, worst * rank_, 1, rank_).setZero();
        }
        std::copy_n(expanded_.data() + worst * rank_ * columns_, rank_ * columns_,
                    expanded_.data() + empty * rank_ * columns_);
        gram_.middleRows(empty * rank_, rank_) = gram_.middleRows(worst * rank_, rank_).eval();
        gram_.middleCols(empty * rank_, rank_) = gram_.middleCols(worst * rank_, rank_).eval();
        projections_.middleCols(empty * rank_, rank_) =
            projections_.middleCols(worst * rank_, rank_).eval();
    }
}

// Section 4.3: the residual of the members (Eq. 20, R'_c) is decomposed by N-SVD. Membership stays.
void Fit::update(Index c, int sweeps) {
    Cluster& cluster = clusters_[at(c)];
    residual(c);
    std::vector<MatrixF> bases = std::move(cluster.bases);
    decomposition_.run(executor_, residual_, ranks_, sweeps, kSweepTolerance, bases, cluster.core);
    cluster.mixing = std::move(bases[0]);
    cluster.bases = std::move(bases);
    cluster.bases[0].resize(0, 0);
    for (std::size_t i = 0; i < cluster.members.size(); ++i) {
        mixing_.block(cluster.members[i], c * rank_, 1, rank_) =
            cluster.mixing.row(static_cast<Index>(i));
    }
    expand(c);
}

void Fit::residual(Index c) {
    const std::vector<Index>& members = clusters_[at(c)].members;
    const Index rows = static_cast<Index>(members.size());
    // The other clusters that these members are mixed from, and their coefficients.
    std::vector<Index> others;
    for (Index j = 0; j < count_; ++j) {
        const bool shared = j != c && std::any_of(members.begin(), members.end(), [&](Index i) {
                                return !mixing_.block(i, j * rank_, 1, rank_).isZero(0);
                            });
        if (shared) others.push_back(j);
    }
    const Index width = static_cast<Index>(others.size()) * rank_;
    MatrixF mixing(rows, width);
    for (Index row = 0; row < rows; ++row) {
        for (std::size_t j = 0; j < others.size(); ++j) {
            mixing.block(row, static_cast<Index>(j) * rank_, 1, rank_) =
                mixing_.block(members[at(row)], others[j] * rank_, 1, rank_);
        }
    }
    Shape shape = tensor_.shape();
    shape[0] = rows;
    residual_.reset(shape);
    std::vector<Buffer> gathered(at(executor_.threads()));
    executor_.parallel_for((columns_ + kColumns - 1) / kColumns, [&](Index task, int worker) {
        const Index first = task * kColumns, count = std::min(kColumns, columns_ - first);
        for (Index row = 0; row < rows; ++row) {
            std::copy_n(tensor_.data() + members[at(row)] * columns_ + first, count,
                        residual_.data() + row * columns_ + first);
        }
        if (width == 0) return;
        Buffer& basis = gathered[at(worker)];
        basis.reserve(width * kColumns);
        for (std::size_t j = 0; j < others.size(); ++j) {
            for (Index r = 0; r < rank_; ++r) {
                std::copy_n(expanded_.data() + (others[j] * rank_ + r) * columns_ + first, count,
                            basis.data() + (static_cast<Index>(j) * rank_ + r) * count);
            }
        }
        gemm(Op::kNone, Op::kNone, rows, count, width, -1.0f, mixing.data(), width, basis.data(),
             count, 1.0f, residual_.data() + first, columns_);
    });
}

void Fit::expand(Index c) {
    const Cluster& cluster = clusters_[at(c)];
    std::vector<const MatrixF*> bases(cluster.bases.size(), nullptr);
    for (std::size_t n = 1; n < bases.size(); ++n) {
        if (cluster.bases[n].size() > 0) bases[n] = &cluster.bases[n];
    }
    multi_mode_product(executor_, cluster.core, bases, Op::kNone, expanded_one_, scratch_);
    std::copy_n(expanded_one_.data(), expanded_one_.size(),
                expanded_.data() + c * rank_ * columns_);
}

// The sparse rows of the clustered mode's basis. A row has fewer clusters than mixtures only if the
// first guess (hard clusters) was the best result: then others join with coefficients 0.
void store_mixing(const std::vector<Cluster>& clusters, Index items, Index rank, Index mixtures,
                  Kcta& result) {
    result.members.reserve(at(items * mixtures));
    result.coefficients.reserve(at(items * mixtures * rank));
    for (Index i = 0; i < items; ++i) {
        std::vector<bool> member(clusters.size(), false);
        Index found = 0;
        for (std::size_t c = 0; c < clusters.size(); ++c) {
            const std::vector<Index>& list = clusters[c].members;
            member[c] = std::binary_search(list.begin(), list.end(), i);
            found += member[c];
        }
        Index missing = mixtures - found;
        for (std::size_t c = 0; c < clusters.size(); ++c) {
            const std::vector<Index>& list = clusters[c].members;
            if (member[c]) {
                const Index row = std::lower_bound(list.begin(), list.end(), i) - list.begin();
                const float* values = clusters[c].mixing.data() + row * rank;
                result.coefficients.insert(result.coefficients.end(), values, values + rank);
            } else if (missing > 0) {
                --missing;
                result.coefficients.insert(result.coefficients.end(), at(rank), 0.0f);
            } else {
                continue;
            }
            result.members.push_back(static_cast<ClusterId>(c));
        }
    }
}

// The inverse of move_to_front.
Tensor move_from_front(const Tensor& tensor, Index mode) {
    Shape shape = tensor.shape();
    std::rotate(shape.begin(), shape.begin() + 1, shape.begin() + mode + 1);
    Tensor moved(shape);
    const auto [outer, rows, inner] = unfolding(shape, mode);
    for (Index r = 0; r < rows; ++r) {
        for (Index o = 0; o < outer; ++o) {
            std::copy_n(tensor.data() + (r * outer + o) * inner, inner,
                        moved.data() + (o * rows + r) * inner);
        }
    }
    return moved;
}

}  // namespace

Kcta kcta(Executor& executor, const TensorSource& source, const KctaOptions& options) {
    const Shape& shape = source.shape();
    validate(shape, options);
    const Index order = static_cast<Index>(shape.size()), m = options.clustered;

    // Section 5.2: global bases first, from the tensor with every other mode in full.
    NsvdOptions global;
    global.ranks.assign(shape.size(), 0);
    for (Index mode : options.global_modes) global.ranks[at(mode)] = options.ranks[at(mode)];
    Kcta result;
    result.bases.resize(shape.size());
    Tensor reduced;
    double energy = 0;
    if (options.global_modes.size() == 1) {  // straight into the order that the fit needs
        const Index mode = options.global_modes[0];
        executor.stage(0, 0.35, "K-CTA: covariance");
        const MatrixD covariance = gram(executor, source, mode);
        energy = covariance.trace();
        result.bases[at(mode)].push_back(leading_basis(covariance, options.ranks[at(mode)]));
        executor.stage(0.35, 0.45, "K-CTA: projection");
        reduced = project(executor, source, mode, result.bases[at(mode)][0], m);
    } else if (!options.global_modes.empty()) {
        Tucker tucker = nsvd(executor, source, global);
        energy = tucker.squared_norm;
        for (Index mode : options.global_modes) {
            result.bases[at(mode)].push_back(std::move(tucker.bases[at(mode)]));
        }
        reduced = move_to_front(executor, tucker.core, m);
    } else {
        executor.stage(0, 0.45, "K-CTA: reading");
        reduced = load(executor, source, m);
        energy = squared_norm(executor, reduced);
        if (!std::isfinite(energy)) source.throw_invalid();
    }

    std::vector<Index> ranks;  // clustered mode first
    for (Index n = 0; n < order; ++n)
        ranks.push_back(global.ranks[at(n)] ? 0 : options.ranks[at(n)]);
    std::rotate(ranks.begin(), ranks.begin() + m, ranks.begin() + m + 1);

    executor.stage(0.45, 0.5, "K-CTA: first clusters");
    Fit fit(executor, std::move(reduced), ranks, options, energy);
    fit.start();
    fit.iterate();
    executor.stage(1, 1, "K-CTA: done");

    for (const Cluster& cluster : fit.clusters()) {
        result.cores.push_back(move_from_front(cluster.core, m));
        for (Index n = 0, other = 1; n < order; ++n) {
            if (n == m) continue;
            const MatrixF& basis = cluster.bases[at(other++)];
            if (basis.size() > 0) result.bases[at(n)].push_back(basis);
        }
    }
    store_mixing(fit.clusters(), shape[at(m)], options.ranks[at(m)], options.mixtures, result);
    result.errors = fit.errors();
    result.squared_norm = energy;
    result.iterations = fit.iterations();
    return result;
}

MatrixD core_gram(Executor& executor, const std::vector<Tensor>& cores,
                  const std::vector<std::vector<MatrixF>>& bases, Index clustered) {
    const Index count = static_cast<Index>(cores.size());
    const Index rank = cores[0].dim(clustered);
    const Index order = cores[0].order();
    MatrixD result(count * rank, count * rank);
    const auto basis = [&](Index n, Index c) -> const MatrixF& {
        return bases[at(n)].size() == 1 ? bases[at(n)][0] : bases[at(n)][at(c)];
    };
    executor.parallel_for(
        count * count,
        [&](Index task, int) {
            const Index j = task / count, c = task % count;
            if (c < j) return;
            // Z_j^(c) = Z_j x_n (U_n,c^T U_n,j) over the modes but m (Eq. 14).
            const Tensor& from = cores[at(j)];
            std::vector<double> values(from.data(), from.data() + from.size()), next;
            Shape shape = from.shape();
            for (Index n = 0; n < order; ++n) {
                if (n == clustered) continue;
                const MatrixD change =
                    basis(n, c).cast<double>().transpose() * basis(n, j).cast<double>();
                const auto [outer, rows, inner] = unfolding(shape, n);
                shape[at(n)] = change.rows();
                next.resize(at(product(shape)));
                for (Index o = 0; o < outer; ++o) {
                    gemm(Op::kNone, Op::kNone, change.rows(), inner, rows, 1.0, change.data(), rows,
                         values.data() + o * rows * inner, inner, 0.0,
                         next.data() + o * change.rows() * inner, inner);
                }
                std::swap(values, next);
            }
            const Tensor& to = cores[at(c)];
            const auto [outer, rows, inner] = unfolding(shape, clustered);
            MatrixD block = MatrixD::Zero(rank, rank);
            for (Index o = 0; o < outer; ++o) {
                const Eigen::Map<const MatrixD> left(values.data() + o * rows * inner, rows, inner);
                const Eigen::Map<const MatrixF> right(to.data() + o * rows * inner, rows, inner);
                block += left * right.cast<double>().transpose();
            }
            result.block(j * rank, c * rank, rank, rank) = block;
            result.block(c * rank, j * rank, rank, rank) = block.transpose();
        },
        true);
    return result;
}

}  // namespace nacre
