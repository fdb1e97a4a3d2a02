#include "nacre/evaluator.hpp"

#include <algorithm>
#include <cstring>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include "nacre/blas.hpp"
#include "nacre/errors.hpp"
#include "texel_kernel.hpp"

namespace nacre {

namespace {

constexpr Index kLight = 0, kView = 1, kY = 2, kX = 3;
constexpr Index kRowChunk = 16;      // rows of texels that are expanded together
constexpr Index kTexelChunk = 2048;  // texels that one task decodes
constexpr std::size_t kHugePage = std::size_t{2} << 20;

constexpr std::array<const char*, 4> kNames{"light", "view", "y", "x"};

// The cluster of each mode that a core belongs to.
std::array<Index, 4> cluster_vector(const Evaluator::Model& model, Index number) {
    std::array<Index, 4> vector{};
    for (std::size_t n = 4; n-- > 0;) {
        vector[n] = number % model.modes[n].clusters;
        number /= model.modes[n].clusters;
    }
    return vector;
}

// Which of a mode's bases belongs to a cluster vector.
Index owner_of(const Evaluator::Model& model, std::size_t mode,
               const std::array<Index, 4>& vector) {
    if (model.modes[mode].owners == 1) return 0;
    Index owner = 0;
    for (std::size_t n = 0; n < 4; ++n) {
        if (n != mode) owner = owner * model.modes[n].clusters + vector[n];
    }
    return owner;
}

// The rows of a mode that a cluster has, at which of their slots.
struct ClusterRows {
    std::vector<Index> rows, slots;
};

ClusterRows rows_of(const Evaluator::Mode& mode, Index cluster) {
    ClusterRows result;
    for (Index i = 0; i < mode.rows; ++i) {
        for (Index k = 0; k < mode.mixtures; ++k) {
            const std::uint32_t member = mode.members ? mode.members[i * mode.mixtures + k] : 0;
            if (static_cast<Index>(member) != cluster) continue;
            result.rows.push_back(i);
            result.slots.push_back(k);
        }
    }
    return result;
}

MatrixF gather(const Evaluator::Mode& mode, Index owner, const ClusterRows& some) {
    MatrixF result(static_cast<Index>(some.rows.size()), mode.rank);
    for (std::size_t i = 0; i < some.rows.size(); ++i) {
        const Index row = (owner * mode.rows + some.rows[i]) * mode.mixtures + some.slots[i];
        std::copy_n(mode.basis + row * mode.rank, mode.rank,
                    result.data() + static_cast<Index>(i) * mode.rank);
    }
    return result;
}

// Large textures go on large pages: random texels would miss the address cache each time.
float* allocate(std::size_t floats) {
    const std::size_t alignment = floats * sizeof(float) >= 2 * kHugePage ? kHugePage : 64;
    const std::size_t bytes = (floats * sizeof(float) + alignment - 1) / alignment * alignment;
    void* memory = std::aligned_alloc(alignment, bytes);
    if (!memory) throw std::bad_alloc();
#if defined(__linux__)
    if (alignment == kHugePage) madvise(memory, bytes, MADV_HUGEPAGE);  // only advice
#endif
    return static_cast<float*>(memory);
}

}  // namespace

void Evaluator::Free::operator()(float* p) const { std::free(p); }

// What decoding one (light, view) needs beside the texture.
struct Evaluator::Scratch {
    std::vector<Index> blocks;         // K_light x K_view: where in a texel's slot the blocks begin
    std::vector<float> weights;        // spatial combinations x channel groups x blocks x lanes
    Index group = 0, combination = 0;  // floats of one channel group and of one combination
    std::vector<float> lit;            // channels x R_light, and R_view
};

void Evaluator::check(const Model& model) {
    require(model.channels >= 1, "channels: expected 1 or more, got ", model.channels);
    for (std::size_t n = 0; n < 4; ++n) {
        const Mode& mode = model.modes[n];
        const Index tied = n == 0 ? model.channels : 1;
        require(mode.rank >= 1 && mode.rows >= 1 && mode.mixtures >= 1, "basis: expected a ",
                kNames[n], " basis of at least one row, mixture and rank");
        require(mode.rows % tied == 0, "channels: expected a divisor of the ", mode.rows,
                " light rows, got ", tied);
        require(mode.clusters >= mode.mixtures, "clusters: expected at least the ", mode.mixtures,
                " mixtures of the mode ", kNames[n], ", got ", mode.clusters);
        Index others = 1;
        for (std::size_t m = 0; m < 4; ++m) others *= m == n ? 1 : model.modes[m].clusters;
        require(mode.owners == 1 || mode.owners == others, "basis: expected 1 or ", others,
                " owners of the ", kNames[n], " basis, got ", mode.owners);
        if (!mode.members) {
            require(mode.clusters == 1, "members: expected those of the clustered mode ",
                    kNames[n]);
            continue;
        }
        for (Index i = 0; i < mode.rows / tied; ++i) {
            const std::uint32_t* set = mode.members + i * mode.mixtures;
            for (Index k = 0; k < mode.mixtures; ++k) {
                require(static_cast<Index>(set[k]) < mode.clusters,
                        "members: expected clusters below ", mode.clusters, ", got ", set[k],
                        " for ", kNames[n], " ", i);
                require(std::find(set, set + k, set[k]) == set + k,
                        "members: expected distinct clusters, got ", set[k], " twice for ",
                        kNames[n], " ", i);
            }
        }
    }
}

Evaluator::Rows Evaluator::keep(const Mode& mode, Index items) {
    Rows rows{mode.clusters, mode.owners, mode.rows, mode.mixtures, mode.rank, {}, {}};
    rows.basis.assign(mode.basis, mode.basis + mode.owners * mode.rows * mode.mixtures * mode.rank);
    rows.members.assign(at(items * mode.mixtures), 0);
    if (mode.members) {
        std::copy_n(mode.members, rows.members.size(), rows.members.begin());
    }
    return rows;
}

Evaluator::Evaluator(Executor& executor, const Model& model) {
    check(model);
    const auto& [light, view, y, x] = model.modes;
    channels_ = model.channels;
    light_ = keep(light, light.rows / channels_);
    view_ = keep(view, view.rows);
    height_ = y.rows;
    width_ = x.rows;
    spatial_ = y.clusters * x.clusters;
    slots_ = y.mixtures * x.mixtures;
    block_ = light.rank * view.rank;
    stride_ = (block_ + kLanes - 1) / kLanes * kLanes;
    record_ = slots_ * light.clusters * view.clusters * stride_;
    texture_.reset(allocate(at(height_ * width_ * record_)));
    place(model);
    expand(executor, model);
}

void Evaluator::place(const Model& model) {
    const auto& [light, view, y, x] = model.modes;
    const auto member = [](const Mode& mode, Index item, Index slot) {
        return mode.members ? mode.members[item * mode.mixtures + slot] : 0;
    };
    places_.reserve(at(height_ * width_ * slots_));
    for (Index texel = 0; texel < height_ * width_; ++texel) {
        for (Index slot = 0; slot < slots_; ++slot) {
            const Index row = member(y, texel / width_, slot / x.mixtures);
            const Index column = member(x, texel % width_, slot % x.mixtures);
            places_.push_back(static_cast<std::uint32_t>(row * x.clusters + column));
        }
    }
}

// texture[y, x][slot][light cluster][view cluster] = Z_c x_y (U_y,c)_y* x_x (U_x,c)_x*
void Evaluator::expand(Executor& executor, const Model& model) {
    const auto& [light, view, y, x] = model.modes;
    const Index clusters = light.clusters * view.clusters * spatial_;
    const Index chunks = (height_ + kRowChunk - 1) / kRowChunk;
    executor.parallel_for(clusters * chunks, [&](Index task, int) {
        const Index cluster = task / chunks;
        const std::array<Index, 4> vector = cluster_vector(model, cluster);
        ClusterRows rows = rows_of(y, vector[kY]);
        const ClusterRows columns = rows_of(x, vector[kX]);
        const Index first = task % chunks * kRowChunk;
        const Index members = static_cast<Index>(rows.rows.size());
        const Index count = std::min(kRowChunk, members - first);
        if (count <= 0 || columns.rows.empty()) return;
        rows.rows = {rows.rows.begin() + first, rows.rows.begin() + first + count};
        rows.slots = {rows.slots.begin() + first, rows.slots.begin() + first + count};
        const MatrixF basis_y = gather(y, owner_of(model, kY, vector), rows);
        const MatrixF basis_x = gather(x, owner_of(model, kX, vector), columns);

        // The core with its blocks last, R_y x R_x x (R_light R_view), then both products.
        const Eigen::Map<const MatrixF> core(model.core + cluster * block_ * y.rank * x.rank,
                                             block_, y.rank * x.rank);
        const MatrixF turned = core.transpose();
        MatrixF strip(count, x.rank * block_);
        gemm(Op::kNone, Op::kNone, count, x.rank * block_, y.rank, 1.0f, basis_y.data(), y.rank,
             turned.data(), x.rank * block_, 0.0f, strip.data(), x.rank * block_);
        const Index across = basis_x.rows();
        MatrixF texels(across, block_);
        const Index place = vector[kLight] * view.clusters + vector[kView];
        for (Index i = 0; i < count; ++i) {
            gemm(Op::kNone, Op::kNone, across, block_, x.rank, 1.0f, basis_x.data(), x.rank,
                 strip.data() + i * x.rank * block_, block_, 0.0f, texels.data(), block_);
            for (Index j = 0; j < across; ++j) {
                const Index texel = rows.rows[at(i)] * width_ + columns.rows[at(j)];
                const Index slot = rows.slots[at(i)] * x.mixtures + columns.slots[at(j)];
                const Index block = slot * light.clusters * view.clusters + place;
                float* to = texture_.get() + texel * record_ + block * stride_;
                std::copy_n(texels.data() + j * block_, block_, to);
                std::fill(to + block_, to + stride_, 0.0f);
            }
        }
    });
}

// A block's weights are the outer product of the light's and the view's rows, for each channel.
void Evaluator::weigh(Index light, Index view, Scratch& scratch) const {
    const std::uint32_t* light_set = light_.members.data() + light * light_.mixtures;
    const std::uint32_t* view_set = view_.members.data() + view * view_.mixtures;
    scratch.blocks.clear();
    for (Index k = 0; k < light_.mixtures; ++k) {
        for (Index j = 0; j < view_.mixtures; ++j) {
            scratch.blocks.push_back((light_set[k] * view_.clusters + view_set[j]) * stride_);
        }
    }
    const Index blocks = light_.mixtures * view_.mixtures;
    scratch.combination = blocks * stride_ * channels_;
    scratch.group = blocks * stride_ * kGroup;
    scratch.weights.assign(at(spatial_ * scratch.combination), 0.0f);
    for (Index s = 0; s < spatial_; ++s) {
        for (Index block = 0; block < blocks; ++block) {
            const Index k = block / view_.mixtures, j = block % view_.mixtures;
            const Index light_owner = light_.owners == 1 ? 0 : view_set[j] * spatial_ + s;
            const Index view_owner = view_.owners == 1 ? 0 : light_set[k] * spatial_ + s;
            const float* seen =
                view_.basis.data() +
                ((view_owner * view_.rows + view) * view_.mixtures + j) * view_.rank;
            for (Index c = 0; c < channels_; ++c) {
                const Index row = light_owner * light_.rows + light * channels_ + c;
                const float* lit = light_.basis.data() + (row * light_.mixtures + k) * light_.rank;
                // Lanes of the channels of a group alternate: see texel_kernel.hpp.
                const Index width = std::min(kGroup, channels_ - c / kGroup * kGroup);
                float* to = scratch.weights.data() + s * scratch.combination +
                            c / kGroup * scratch.group + block * stride_ * width +
                            c % kGroup * kLanes;
                for (Index i = 0; i < block_; ++i) {
                    to[i / kLanes * kLanes * width + i % kLanes] =
                        lit[i / view_.rank] * seen[i % view_.rank];
                }
            }
        }
    }
}

void Evaluator::decode_some(std::span<const Index> texels, const Scratch& scratch,
                            float* out) const {
    const Index count = static_cast<Index>(texels.size());
    const Index slot = light_.clusters * view_.clusters * stride_;
    for (Index first = 0; first < channels_; first += kGroup) {
        const Index width = std::min(kGroup, channels_ - first);
        const float* weights = scratch.weights.data() + first / kGroup * scratch.group;
        const TexelKernel kernel = texel_kernel(static_cast<int>(width));
        if (spatial_ == 1) {  // texels share their weights
            kernel({texture_.get(), record_, texels.data(), count, scratch.blocks.data(),
                    static_cast<Index>(scratch.blocks.size()), stride_, weights, out + first,
                    channels_});
            continue;
        }
        for (Index i = 0; i < count; ++i) {
            float* value = out + i * channels_ + first;
            std::fill_n(value, width, 0.0f);
            for (Index k = 0; k < slots_; ++k) {
                const std::uint32_t place = places_[at(texels[at(i)] * slots_ + k)];
                float part[kGroup];
                kernel({texture_.get() + k * slot, record_, &texels[at(i)], 1,
                        scratch.blocks.data(), static_cast<Index>(scratch.blocks.size()), stride_,
                        weights + place * scratch.combination, part, width});
                for (Index c = 0; c < width; ++c) value[c] += part[c];
            }
        }
    }
}

void Evaluator::decode(Executor& executor, std::span<const Index> lights,
                       std::span<const Index> views, std::span<const Index> texels,
                       bool shared_texels, float* out) const {
    const Index pairs = static_cast<Index>(lights.size());
    if (pairs == 0 || texels.empty()) return;
    const Index count = static_cast<Index>(texels.size()) / (shared_texels ? 1 : pairs);
    const Index chunks = (count + kTexelChunk - 1) / kTexelChunk;
    // Several pairs a task where they have few texels.
    const Index together = std::max<Index>(1, kTexelChunk / count);
    std::vector<Scratch> scratch(at(executor.threads()));
    executor.parallel_for((pairs + together - 1) / together * chunks, [&](Index task, int worker) {
        const Index first = task % chunks * kTexelChunk;
        const Index part = std::min(kTexelChunk, count - first);
        const Index begin = task / chunks * together;
        for (Index p = begin; p < std::min(pairs, begin + together); ++p) {
            weigh(lights[at(p)], views[at(p)], scratch[at(worker)]);
            decode_some(texels.subspan(at((shared_texels ? 0 : p * count) + first), at(part)),
                        scratch[at(worker)], out + (p * count + first) * channels_);
        }
    });
}

}  // namespace nacre
