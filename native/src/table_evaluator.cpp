#include "nacre/table_evaluator.hpp"

#include <algorithm>
#include <cmath>

#include "nacre/errors.hpp"
#include "table_kernel.hpp"
#include "thin_product.hpp"

namespace nacre {

namespace {

constexpr Index kPoints = 64;        // of one block: their sums stay in the first cache
constexpr Index kBlocks = 16;        // of points that one task evaluates
constexpr Index kTile = 512 * 1024;  // bytes of the core that one tile of texels has at most
constexpr Index kLeastTexels = 64, kMostTexels = 1024;

void check_mode(const char* name, Index clusters, Index owners, Index others, Index mixtures,
                const std::uint32_t* index, Index map) {
    require(clusters >= 1, "core: expected one or more clusters of the ", name);
    require(mixtures >= 1 && mixtures <= clusters, name, "_index: expected 1 to ", clusters,
            " mixtures (the clusters), got ", mixtures);
    require(owners == 1 || owners == others, name, ": expected 1 or ", others, " owners, got ",
            owners);
    const std::uint32_t largest = *std::max_element(index, index + mixtures * map);
    require(static_cast<Index>(largest) < clusters, name, "_index: expected clusters below ",
            clusters, ", got ", largest);
}

// Where a coordinate lies on a mode of `size` texels that repeats: two of them, and how far the
// second one counts.
struct Between {
    Index first, second;
    double along;
};

Between between(double coordinate, Index size) {
    const double place = coordinate * static_cast<double>(size) - 0.5;
    const double corner = std::floor(place);
    const double count = static_cast<double>(size);
    const double wrapped = corner - count * std::floor(corner / count);
    const Index first = std::clamp<Index>(static_cast<Index>(wrapped), 0, size - 1);
    return {first, first + 1 == size ? 0 : first + 1, place - corner};
}

}  // namespace

Index parabolic_texel(const Vector3& direction, Index size) {
    const double reach = std::sqrt(direction[0] * direction[0] + direction[1] * direction[1]);
    const double down = std::max(std::max(1.0 + direction[2], reach), 1e-6);
    const double half = static_cast<double>(size / 2);
    const auto texel = [&](double along) {
        const double place = std::floor(along / down * (half - 1.0) + (half + 0.5));
        return static_cast<Index>(std::clamp(place, 0.0, static_cast<double>(size - 1)));
    };
    return texel(direction[1]) * size + texel(direction[0]);
}

TableEvaluator::TableEvaluator(const Tables& tables) : tables_(tables) {
    const Tables& t = tables_;
    require(t.light_rank >= 1 && t.view_quads >= 1 && t.height >= 1 && t.width >= 1,
            "core: expected at least one rank and texel");
    require(t.size >= 2 && t.channels >= 1,
            "light: expected a map of 2 texels or more, of one "
            "channel or more");
    require(t.lit() || (t.light_clusters == 1 && t.light_rank == 1),
            "core: expected one light cluster and rank of occlusion");
    check_mode("light", t.light_clusters, t.light_owners, t.view_clusters, t.light_mixtures,
               t.light_index, t.map());
    check_mode("view", t.view_clusters, t.view_owners, t.light_clusters, t.view_mixtures,
               t.view_index, t.map());
}

// What a patch needs beside the tables: the lights above the horizon, and the clusters they use.
struct TableEvaluator::PatchWork {
    struct Lamp {
        Index number;              // which of the lights
        std::vector<Index> slots;  // of its clusters among `clusters`
        std::vector<float> rows;   // owners x channels x mixtures x rank
    };
    std::vector<Lamp> lamps;
    std::vector<Index> clusters;
    // Sets of reduced vectors: one for each mixture of the view where its clusters have light rows
    // of their own, else one.
    Index sets = 1;

    PatchWork(const Tables& t, std::span<const Vector3> lights) {
        if (t.light_owners > 1) sets = t.view_mixtures;
        if (!t.lit()) clusters.push_back(0);
        for (std::size_t l = 0; l < lights.size(); ++l) {
            if (!(lights[l][2] > 0.0)) continue;
            const Index texel = parabolic_texel(lights[l], t.size);
            Lamp lamp{static_cast<Index>(l), {}, {}};
            for (Index k = 0; k < t.light_mixtures; ++k) {
                const Index cluster = t.light_index[k * t.map() + texel];
                const auto found = std::find(clusters.begin(), clusters.end(), cluster);
                lamp.slots.push_back(found - clusters.begin());
                if (found == clusters.end()) clusters.push_back(cluster);
            }
            for (Index row = 0; row < t.light_owners * t.channels * t.light_mixtures; ++row) {
                for (Index r = 0; r < t.light_rank; ++r) {
                    const Index quad = (row * t.light_quads() + r / 4) * t.map() + texel;
                    lamp.rows.push_back(t.light[quad * 4 + r % 4]);
                }
            }
            lamps.push_back(std::move(lamp));
        }
    }
};

void TableEvaluator::patch(Executor& executor, std::span<const Vector3> lights,
                           std::span<const Vector3> views, float* out) const {
    const Tables& t = tables_;
    const PatchWork work(t, lights);
    const Index texels = t.height * t.width, rank = t.light_rank;
    const Index values = texels * t.channels, view_count = static_cast<Index>(views.size());
    if (t.lit()) std::fill_n(out, static_cast<Index>(lights.size()) * view_count * values, 0.0f);
    if (work.clusters.empty() || view_count == 0) return;

    // All views of a tile while its part of the core is in the second cache.
    const Index of_texel = t.light_clusters * t.view_clusters * rank * t.view_quads * 16;
    const Index tile = std::clamp(kTile / of_texel / 8 * 8, kLeastTexels, kMostTexels);
    const Index vectors = static_cast<Index>(work.clusters.size()) * work.sets * rank;
    const Index depth = t.light_mixtures * work.sets * rank;
    const TableKernel& kernel = table_kernel();
    struct Scratch {
        std::vector<const float*> planes, lines;
        std::vector<float> rows, reduced, weights, sums;
        std::vector<float*> channels;
    };
    std::vector<Scratch> all(at(executor.threads()));

    executor.parallel_for((texels + tile - 1) / tile, [&](Index task, int worker) {
        const Index first = task * tile, count = std::min(tile, texels - first);
        Scratch& scratch = all[at(worker)];
        scratch.reduced.resize(at(vectors * tile));
        scratch.weights.resize(at(t.channels * depth));
        scratch.sums.resize(at(t.channels * tile));
        scratch.lines.resize(at(depth));
        scratch.channels.clear();
        for (Index c = 0; c < t.channels; ++c) {
            scratch.channels.push_back(scratch.sums.data() + c * tile);
        }
        // Mixtures of the view that are summed at once, and that have a set for themselves.
        const Index together = t.view_mixtures / work.sets;
        scratch.planes.resize(at(together * t.view_quads));
        scratch.rows.resize(at(together * t.view_quads * 4));

        for (Index v = 0; v < view_count; ++v) {
            const Index texel = parabolic_texel(views[at(v)], t.size);
            float* reduced = scratch.reduced.data();
            for (const Index cluster : work.clusters) {
                const Index owner = t.view_owners > 1 ? cluster : 0;
                for (Index set = 0; set < work.sets; ++set) {
                    for (Index i = 0; i < together * t.view_quads; ++i) {
                        const Index row = set * together * t.view_quads + i;
                        const Index quad = owner * t.view_mixtures * t.view_quads + row;
                        std::copy_n(t.view + (quad * t.map() + texel) * 4, 4,
                                    scratch.rows.data() + 4 * i);
                    }
                    for (Index r = 0; r < rank; ++r, reduced += tile) {
                        for (Index i = 0; i < together * t.view_quads; ++i) {
                            const Index k = set * together + i / t.view_quads;
                            const Index block =
                                cluster * t.view_clusters + t.view_index[k * t.map() + texel];
                            const Index quad = (block * rank + r) * t.view_quads + i % t.view_quads;
                            scratch.planes[at(i)] = t.core + quad * t.plane() + 4 * first;
                        }
                        kernel.quads({scratch.planes.data(), scratch.rows.data(),
                                      together * t.view_quads, count, reduced});
                    }
                }
            }
            if (!t.lit()) {
                std::copy_n(scratch.reduced.data(), count, out + v * texels + first);
                continue;
            }
            for (const PatchWork::Lamp& lamp : work.lamps) {
                for (Index i = 0; i < depth; ++i) {
                    const Index k = i / (work.sets * rank), set = i / rank % work.sets;
                    const Index owner =
                        t.light_owners > 1 ? t.view_index[set * t.map() + texel] : 0;
                    const Index line = (lamp.slots[at(k)] * work.sets + set) * rank + i % rank;
                    scratch.lines[at(i)] = scratch.reduced.data() + line * tile;
                    for (Index c = 0; c < t.channels; ++c) {
                        const Index row = (owner * t.channels + c) * t.light_mixtures + k;
                        scratch.weights[at(c * depth + i)] = lamp.rows[at(row * rank + i % rank)];
                    }
                }
                thin_product(t.channels, count, depth, scratch.weights.data(), scratch.lines.data(),
                             false, scratch.channels.data());
                float* to = out + (lamp.number * view_count + v) * values + first * t.channels;
                for (Index c = 0; c < t.channels; ++c) {
                    const float* sums = scratch.channels[at(c)];
                    for (Index i = 0; i < count; ++i) {
                        to[i * t.channels + c] = std::max(sums[i], 0.0f);
                    }
                }
            }
        }
    });
}

void TableEvaluator::points(Executor& executor, std::span<const Vector3> lights,
                            std::span<const Vector3> views, std::span<const double[2]> uv,
                            float* out) const {
    const Tables& t = tables_;
    require(t.lit(), "tables: expected those of a BTF, not of occlusion");
    const Index total = static_cast<Index>(uv.size());
    const TableKernel& kernel = table_kernel();
    struct Scratch {
        std::vector<PointSums::Point> points;
        std::vector<Index> numbers, light_texels, view_texels;
        std::vector<float> rows, totals;
        std::vector<float> weights;
    };
    std::vector<Scratch> all(at(executor.threads()));

    const auto block = [&](Index begin, Index end, Scratch& scratch) {
        scratch.points.clear();
        scratch.numbers.clear();
        scratch.light_texels.clear();
        scratch.view_texels.clear();
        scratch.weights.clear();
        for (Index p = begin; p < end; ++p) {
            if (!(lights[at(p)][2] > 0.0)) {
                std::fill_n(out + p * t.channels, t.channels, 0.0f);
                continue;
            }
            const Between x = between(uv[at(p)][0], t.width), y = between(uv[at(p)][1], t.height);
            const Index low = y.first * t.width, high = y.second * t.width;
            scratch.points.push_back({nullptr,
                                      nullptr,
                                      {4 * (low + x.first), 4 * (low + x.second),
                                       4 * (high + x.first), 4 * (high + x.second)}});
            for (const double up : {1.0 - y.along, y.along}) {
                scratch.weights.push_back(static_cast<float>(up * (1.0 - x.along)));
                scratch.weights.push_back(static_cast<float>(up * x.along));
            }
            scratch.numbers.push_back(p);
            scratch.light_texels.push_back(parabolic_texel(lights[at(p)], t.size));
            scratch.view_texels.push_back(parabolic_texel(views[at(p)], t.size));
        }
        const Index count = static_cast<Index>(scratch.points.size());
        scratch.rows.resize(at(count * t.view_quads * 2 * kPointLanes));
        for (Index channel = 0; channel < t.channels; channel += kPointChannels) {
            const Index channels = std::min(kPointChannels, t.channels - channel);
            scratch.totals.assign(at(count * channels * kPointLanes), 0.0f);
            for (Index pair = 0; pair < t.light_mixtures * t.view_mixtures; ++pair) {
                const Index kl = pair / t.view_mixtures, kv = pair % t.view_mixtures;
                float* to = scratch.rows.data();
                for (Index p = 0; p < count; ++p) {
                    const Index light_texel = scratch.light_texels[at(p)];
                    const Index view_texel = scratch.view_texels[at(p)];
                    const Index cl = t.light_index[kl * t.map() + light_texel];
                    const Index cv = t.view_index[kv * t.map() + view_texel];
                    const Index light_owner = t.light_owners > 1 ? cv : 0;
                    const Index view_owner = t.view_owners > 1 ? cl : 0;
                    PointSums::Point& point = scratch.points[at(p)];
                    point.core = t.core + (cl * t.view_clusters + cv) * t.light_rank *
                                              t.view_quads * t.plane();
                    const Index row = (light_owner * t.channels + channel) * t.light_mixtures + kl;
                    point.light = t.light + (row * t.light_quads() * t.map() + light_texel) * 4;
                    const float* weights = scratch.weights.data() + 4 * p;
                    for (Index q = 0; q < t.view_quads; ++q) {
                        const Index quad = (view_owner * t.view_mixtures + kv) * t.view_quads + q;
                        const float* from = t.view + (quad * t.map() + view_texel) * 4;
                        for (Index i = 0; i < 2 * kPointLanes; ++i) {
                            *to++ = weights[i / 4] * from[i % 4];
                        }
                    }
                }
                kernel.points({scratch.points.data(), count, scratch.rows.data(), t.light_rank,
                               t.view_quads, t.plane(), channels,
                               t.light_mixtures * t.light_quads() * t.map() * 4, t.map() * 4,
                               scratch.totals.data()});
            }
            for (Index i = 0; i < count * channels; ++i) {
                const float* lanes = scratch.totals.data() + i * kPointLanes;
                float sum = 0.0f;
                for (Index lane = 0; lane < kPointLanes; ++lane) sum += lanes[lane];
                out[scratch.numbers[at(i / channels)] * t.channels + channel + i % channels] =
                    std::max(sum, 0.0f);
            }
        }
    };

    const Index task_points = kPoints * kBlocks;
    executor.parallel_for((total + task_points - 1) / task_points, [&](Index task, int worker) {
        const Index end = std::min(total, (task + 1) * task_points);
        for (Index begin = task * task_points; begin < end; begin += kPoints) {
            block(begin, std::min(end, begin + kPoints), all[at(worker)]);
        }
    });
}

}  // namespace nacre
