#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "dictionary.hpp"
#include "largest.hpp"
#include "nacre/ensemble.hpp"
#include "nacre/errors.hpp"
#include "nacre/gram.hpp"
#include "nacre/random.hpp"

namespace nacre {

namespace {

// How much the Gram matrices of all patches weigh in a dictionary that is made of one: they say
// what to do with the directions that a patch leaves open.
constexpr double kSharedWeight = 0.01;

// Patches that are coded between two sums over them, for each thread.
constexpr Index kPatchesInFlight = 4;

class Fit {
  public:
    Fit(Executor& executor, const Patches& patches, const TrainingOptions& options)
        : executor_(executor),
          patches_(patches),
          options_(options),
          buffers_(patch_buffers(executor, patches)),
          records_(at(kPatchesInFlight * executor.threads())) {}

    Training run(const Training* start, const TrainingCheckpoint& checkpoint);

  private:
    // What one patch adds to the Procrustes problem of one mode.
    struct Record {
        std::uint32_t member = 0;
        double squared_norm = 0, energy = 0;
        std::vector<Coefficient> kept;
        std::vector<float> columns;  // of P = X x_n U_n^T over all other modes n, one a coefficient
    };

    void start();
    std::vector<MatrixD> grams(Index patch, int worker);
    std::vector<MatrixD> shared_grams();
    Dictionary dictionary_of(Index patch, int worker);
    Index draw(Random& random) const;
    double fit_mode(Index mode, bool reassign, bool fit);
    void code_patch(Index patch, int worker, Index mode, bool reassign, Record& record);
    void keep_columns(const float* projected, Index mode, Record& record) const;
    void add_up(Index first, Index count, Index mode, std::vector<MatrixD>& targets);
    void update(Index mode, const std::vector<MatrixD>& targets);
    Index reseed();
    bool converged() const;
    void stage(double part, const std::string& message);

    Executor& executor_;
    const Patches& patches_;
    const TrainingOptions& options_;
    std::vector<PatchBuffers> buffers_;
    std::vector<Record> records_;
    std::vector<MatrixD> shared_;  // Gram matrix of each mode over all patches, of trace 1
    std::vector<double> left_;     // squared error of each patch
    Training result_;
};

// Progress: a tenth for the start, the rest for sweeps.
void Fit::stage(double part, const std::string& message) {
    const double sweeps = options_.sweeps + 1;
    const double at = 0.1 + 0.9 * (result_.sweeps + part) / sweeps;
    executor_.stage(std::min(at, 1.0), std::min(at, 1.0), message);
}

// Of trace 1 each, unless the patch is zero.
std::vector<MatrixD> Fit::grams(Index patch, int worker) {
    PatchBuffers& buffers = buffers_[at(worker)];
    patches_.read(patch, buffers.patch.data());
    std::vector<MatrixD> found;
    for (Index mode = 0; mode < patches_.order(); ++mode) {
        const Unfolding view = unfolding(patches_.shape(), mode);
        GramSum sum(view.rows);
        sum.add(buffers.patch.data(), view);
        found.push_back(sum.finish());
        symmetrise(found.back());
    }
    return found;
}

std::vector<MatrixD> Fit::shared_grams() {
    const Index count = patches_.count(), slabs = slab_count(count);
    std::vector<std::vector<MatrixD>> partial(at(slabs));
    executor_.stage(0, 0.03, "Dictionaries: all patches");
    executor_.parallel_for(
        slabs,
        [&](Index slab, int worker) {
            std::vector<MatrixD>& sum = partial[at(slab)];
            for (Index i = slab * count / slabs; i < (slab + 1) * count / slabs; ++i) {
                const std::vector<MatrixD> own = grams(i, worker);
                if (sum.empty()) {
                    sum = own;
                } else {
                    for (std::size_t n = 0; n < own.size(); ++n) sum[n] += own[n];
                }
            }
        },
        true);
    std::vector<MatrixD> total = partial[0];
    for (std::size_t slab = 1; slab < partial.size(); ++slab) {
        for (std::size_t n = 0; n < total.size(); ++n) total[n] += partial[slab][n];
    }
    result_.squared_norm = total[0].trace();
    for (MatrixD& gram : total) {
        if (gram.trace() > 0) gram /= gram.trace();
    }
    return total;
}

Dictionary Fit::dictionary_of(Index patch, int worker) {
    std::vector<MatrixD> own = grams(patch, worker);
    for (std::size_t n = 0; n < own.size(); ++n) {
        if (own[n].trace() > 0) own[n] /= own[n].trace();
        own[n] += kSharedWeight * shared_[n];
    }
    return hosvd(own);
}

// A patch, by how badly it is coded so far.
Index Fit::draw(Random& random) const {
    const double total = std::accumulate(left_.begin(), left_.end(), 0.0);
    double rest = random.uniform() * total;
    for (std::size_t i = 0; i < left_.size(); ++i) {
        rest -= left_[i];
        if (rest < 0) return static_cast<Index>(i);
    }
    return static_cast<Index>(random.next() % left_.size());  // all are coded without error
}

// The first dictionary is the higher-order SVD of all patches; each further one that of a patch
// that those before code badly (the seeds of k-means++, with the error of coding as distance).
void Fit::start() {
    Random random(options_.seed);
    const Index count = patches_.count(), shares = options_.dictionaries;
    left_.assign(at(count), HUGE_VAL);
    result_.members.assign(at(count), 0);
    result_.ensemble = {hosvd(shared_)};
    for (Index k = 0; k + 1 < shares; ++k) {
        const double share = static_cast<double>(shares - 1);
        executor_.stage(0.03 + 0.07 * static_cast<double>(k) / share,
                        0.03 + 0.07 * static_cast<double>(k + 1) / share, "Dictionaries: seeds");
        const Ensemble newest = {result_.ensemble.back()};
        executor_.parallel_for(
            count,
            [&](Index patch, int worker) {
                PatchBuffers& buffers = buffers_[at(worker)];
                const double norm = patches_.read(patch, buffers.patch.data());
                const Projected p = project(patches_.shape(), newest[0], -1, buffers);
                std::vector<Coefficient> kept;
                largest(p.values, patches_.size(), options_.sparsity, kept);
                const double error = std::max(0.0, norm - energy(kept));
                if (error >= left_[at(patch)]) return;
                left_[at(patch)] = error;
                result_.members[at(patch)] = static_cast<std::uint32_t>(k);
            },
            true);
        result_.ensemble.push_back(dictionary_of(draw(random), 0));
    }
}

void Fit::keep_columns(const float* projected, Index mode, Record& record) const {
    const Unfolding view = unfolding(patches_.shape(), mode);
    record.columns.resize(record.kept.size() * at(view.rows));
    float* to = record.columns.data();
    for (const Coefficient& c : record.kept) {
        const Index position = c.position;
        const float* column = projected +
                              position / (view.rows * view.inner) * view.rows * view.inner +
                              position % view.inner;
        for (Index i = 0; i < view.rows; ++i) *to++ = column[i * view.inner];
    }
}

void Fit::code_patch(Index patch, int worker, Index mode, bool reassign, Record& record) {
    PatchBuffers& buffers = buffers_[at(worker)];
    record.squared_norm = patches_.read(patch, buffers.patch.data());
    record.energy = -1;
    std::vector<Coefficient> kept;
    const Index all = static_cast<Index>(result_.ensemble.size());
    const Index first = reassign ? 0 : result_.members[at(patch)];
    for (Index k = first; k < (reassign ? all : first + 1); ++k) {
        const Dictionary& dictionary = result_.ensemble[at(k)];
        const Projected p = project(patches_.shape(), dictionary, mode, buffers);
        mode_product(p.values, unfolding(patches_.shape(), mode), dictionary[at(mode)],
                     Op::kTranspose, p.spare);
        largest(p.spare, patches_.size(), options_.sparsity, kept);
        const double gained = energy(kept);
        if (gained <= record.energy) continue;
        record.energy = gained;
        record.member = static_cast<std::uint32_t>(k);
        std::swap(record.kept, kept);
        keep_columns(p.values, mode, record);
    }
}

// The sum over patches of P_(n) S_(n)^T, for each dictionary: in the order of the patches, so that
// it has the same bits whatever was coded at the same time.
void Fit::add_up(Index first, Index count, Index mode, std::vector<MatrixD>& targets) {
    const Unfolding view = unfolding(patches_.shape(), mode);
    executor_.parallel_for(static_cast<Index>(targets.size()), [&](Index k, int) {
        MatrixD& target = targets[at(k)];
        for (Index i = 0; i < count; ++i) {
            const Record& record = records_[at(i)];
            if (record.member != k) continue;
            const float* column = record.columns.data();
            for (const Coefficient& c : record.kept) {
                const Index atom = c.position / view.inner % view.rows;
                for (Index a = 0; a < view.rows; ++a) {
                    target(a, atom) += static_cast<double>(*column++) * c.value;
                }
            }
        }
    });
    for (Index i = 0; i < count; ++i) {
        const Record& record = records_[at(i)];
        result_.members[at(first + i)] = record.member;
        left_[at(first + i)] = std::max(0.0, record.squared_norm - record.energy);
    }
}

void Fit::update(Index mode, const std::vector<MatrixD>& targets) {
    executor_.parallel_for(static_cast<Index>(targets.size()), [&](Index k, int) {
        MatrixF& matrix = result_.ensemble[at(k)][at(mode)];
        matrix = procrustes(targets[at(k)], matrix);
    });
}

// One pass over the patches. Returns the objective before the update, as part of the squared norm.
double Fit::fit_mode(Index mode, bool reassign, bool fit) {
    const Index rows = patches_.shape()[at(mode)], count = patches_.count();
    std::vector<MatrixD> targets(result_.ensemble.size(), MatrixD::Zero(rows, rows));
    const Index step = static_cast<Index>(records_.size());
    const double modes = static_cast<double>(patches_.order());
    const std::string message = "Dictionaries: sweep " + std::to_string(result_.sweeps + 1);
    for (Index first = 0; first < count; first += step) {
        const Index some = std::min(step, count - first);
        const double done = static_cast<double>(first) / static_cast<double>(count);
        stage((static_cast<double>(mode) + done) / modes, message);
        executor_.parallel_for(some, [&](Index i, int worker) {
            code_patch(first + i, worker, mode, reassign, records_[at(i)]);
        });
        add_up(first, some, mode, targets);
    }
    const double error = std::accumulate(left_.begin(), left_.end(), 0.0);
    if (fit) update(mode, targets);
    return result_.squared_norm > 0 ? error / result_.squared_norm : 0;
}

// A dictionary without patches becomes that of a patch that is coded badly. Nothing is coded with
// it, so the objective stays; the next sweep gives it patches that it codes better.
Index Fit::reseed() {
    std::vector<Index> patches(result_.ensemble.size());
    for (const std::uint32_t member : result_.members) ++patches[member];
    Index empty = 0;
    for (std::size_t k = 0; k < patches.size(); ++k) {
        if (patches[k]) continue;
        Random random(options_.seed + 1 + at(result_.sweeps) * patches.size() + k);
        result_.ensemble[k] = dictionary_of(draw(random), 0);
        ++empty;
    }
    return empty;
}

bool Fit::converged() const {
    const std::vector<double>& errors = result_.errors;
    if (errors.size() < 2 || result_.reseeded.back() > 0) return false;
    const double last = errors[errors.size() - 2];
    return last - errors.back() <= options_.tolerance * last;
}

Training Fit::run(const Training* begin, const TrainingCheckpoint& checkpoint) {
    shared_ = shared_grams();
    if (begin) {
        const double squared_norm = result_.squared_norm;
        result_ = *begin;
        result_.squared_norm = squared_norm;
        left_.assign(at(patches_.count()), 0);
    } else {
        start();
    }
    while (result_.sweeps < options_.sweeps && !converged()) {
        const bool reassign = result_.sweeps % options_.reassign == 0;
        result_.errors.push_back(fit_mode(0, reassign, true));
        const Index reseeded = reassign ? reseed() : 0;
        for (Index mode = 1; mode < patches_.order(); ++mode) fit_mode(mode, false, true);
        result_.reseeded.push_back(reseeded);
        result_.orthonormality.push_back(orthonormality_error(result_.ensemble));
        ++result_.sweeps;
        if (checkpoint) checkpoint(result_);
    }
    result_.errors.push_back(fit_mode(0, true, false));
    executor_.stage(1, 1, "Dictionaries: done");
    return std::move(result_);
}

}  // namespace

Training train(Executor& executor, const Patches& patches, const TrainingOptions& options,
               const Training* start, const TrainingCheckpoint& checkpoint) {
    require(options.dictionaries >= 1 && options.dictionaries <= patches.count(),
            "dictionaries: expected 1 to ", patches.count(), " (the patches), got ",
            options.dictionaries);
    require(options.sparsity >= 1 && options.sparsity <= patches.size(), "sparsity: expected 1 to ",
            patches.size(), " (the values of a patch), got ", options.sparsity);
    require(options.sweeps >= 0, "sweeps: expected 0 or more, got ", options.sweeps);
    require(options.tolerance >= 0, "tolerance: expected 0 or more, got ", options.tolerance);
    require(options.reassign >= 1, "reassign: expected 1 or more, got ", options.reassign);
    return Fit(executor, patches, options).run(start, checkpoint);
}

}  // namespace nacre
