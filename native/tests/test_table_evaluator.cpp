// Tables against the sum over nonzeros written out in double, one element at a time.
#include <array>

#include "../src/table_kernel.hpp"
#include "check.hpp"
#include "nacre/table_evaluator.hpp"

using namespace nacre;

namespace {

struct Setting {
    Index light_clusters, view_clusters, light_mixtures, view_mixtures;
    Index light_rank, view_quads, height, width, size, channels;
    bool own_lights, own_views;  // rows for each cluster of the other mode
    bool lit = true;
};

// Tables that own their arrays.
struct Owned {
    std::vector<float> core, light, view;
    std::vector<std::uint32_t> light_index, view_index;
    Tables tables;
};

std::vector<float> numbers(Index count, Random& random) {
    std::vector<float> values(at(count));
    for (float& value : values) value = static_cast<float>(random.uniform() - 0.4);
    return values;
}

std::vector<std::uint32_t> clusters(Index mixtures, Index texels, Index count) {
    std::vector<std::uint32_t> index;
    for (Index k = 0; k < mixtures; ++k) {
        for (Index i = 0; i < texels; ++i) {
            index.push_back(static_cast<std::uint32_t>((i * 7 + k) % count));
        }
    }
    return index;
}

Owned random_tables(const Setting& s, std::uint64_t seed) {
    Random random(seed);
    Owned owned;
    Tables& t = owned.tables;
    t.light_clusters = s.light_clusters;
    t.view_clusters = s.view_clusters;
    t.light_mixtures = s.light_mixtures;
    t.view_mixtures = s.view_mixtures;
    t.light_rank = s.light_rank;
    t.view_quads = s.view_quads;
    t.height = s.height;
    t.width = s.width;
    t.size = s.size;
    t.channels = s.channels;
    t.light_owners = s.own_lights ? s.view_clusters : 1;
    t.view_owners = s.own_views ? s.light_clusters : 1;
    owned.core = numbers(
        s.light_clusters * s.view_clusters * s.light_rank * s.view_quads * t.plane(), random);
    owned.view = numbers(t.view_owners * s.view_mixtures * s.view_quads * t.map() * 4, random);
    owned.light = numbers(
        t.light_owners * s.channels * s.light_mixtures * t.light_quads() * t.map() * 4, random);
    owned.light_index = clusters(s.light_mixtures, t.map(), s.light_clusters);
    owned.view_index = clusters(s.view_mixtures, t.map(), s.view_clusters);
    t.core = owned.core.data();
    t.view = owned.view.data();
    if (s.lit) t.light = owned.light.data();
    t.light_index = owned.light_index.data();
    t.view_index = owned.view_index.data();
    return owned;
}

// The sum at one texel, not clamped.
double written_out(const Tables& t, const Vector3& light, const Vector3& view, Index y, Index x,
                   Index channel) {
    const Index light_texel = t.lit() ? parabolic_texel(light, t.size) : 0;
    const Index view_texel = parabolic_texel(view, t.size);
    double sum = 0;
    for (Index kl = 0; kl < t.light_mixtures; ++kl) {
        for (Index kv = 0; kv < t.view_mixtures; ++kv) {
            const Index cl = t.light_index[kl * t.map() + light_texel];
            const Index cv = t.view_index[kv * t.map() + view_texel];
            for (Index r = 0; r < t.light_rank; ++r) {
                double lit = 1;
                if (t.lit()) {
                    const Index row =
                        ((t.light_owners > 1 ? cv : 0) * t.channels + channel) * t.light_mixtures +
                        kl;
                    const Index quad = (row * t.light_quads() + r / 4) * t.map() + light_texel;
                    lit = t.light[quad * 4 + r % 4];
                }
                for (Index i = 0; i < 4 * t.view_quads; ++i) {
                    const Index row = (t.view_owners > 1 ? cl : 0) * t.view_mixtures + kv;
                    const Index quad = (row * t.view_quads + i / 4) * t.map() + view_texel;
                    const Index block = (cl * t.view_clusters + cv) * t.light_rank + r;
                    const Index plane = block * t.view_quads + i / 4;
                    sum += lit * t.view[quad * 4 + i % 4] *
                           t.core[plane * t.plane() + (y * t.width + x) * 4 + i % 4];
                }
            }
        }
    }
    return sum;
}

void direction(Random& random, double up, Vector3& to) {
    const double x = random.uniform() - 0.5, y = random.uniform() - 0.5;
    const double z = up * (0.05 + random.uniform());
    const double length = std::sqrt(x * x + y * y + z * z);
    to[0] = x / length, to[1] = y / length, to[2] = z / length;
}

Index wrapped(double place, Index size) {
    const Index whole = static_cast<Index>(std::floor(place)) % size;
    return whole < 0 ? whole + size : whole;
}

void compare(const Setting& setting, std::uint64_t seed) {
    const Owned owned = random_tables(setting, seed);
    const Tables& t = owned.tables;
    const TableEvaluator evaluator(t);
    Executor executor(2);
    Random random(seed + 1);
    std::array<Vector3, 5> lights, views;
    for (Vector3& light : lights) direction(random, &light == &lights[2] ? -1 : 1, light);
    for (Vector3& view : views) direction(random, &view == &views[1] ? -1 : 1, view);
    const Index texels = t.height * t.width;

    if (!t.lit()) {
        std::vector<float> values(at(5 * texels));
        evaluator.patch(executor, {}, views, values.data());
        for (Index i = 0; i < 5 * texels; ++i) {
            const Index texel = i % texels;
            CHECK_NEAR(values[at(i)],
                       written_out(t, lights[0], views[at(i / texels)], texel / t.width,
                                   texel % t.width, 0),
                       1e-5);
        }
        return;
    }

    std::vector<float> values(at(25 * texels * t.channels), -1.0f);
    evaluator.patch(executor, lights, views, values.data());
    const float* value = values.data();
    for (const Vector3& light : lights) {
        for (const Vector3& view : views) {
            for (Index i = 0; i < texels * t.channels; ++i) {
                const Index texel = i / t.channels;
                const double sum =
                    written_out(t, light, view, texel / t.width, texel % t.width, i % t.channels);
                CHECK_NEAR(*value++, light[2] > 0 ? std::max(sum, 0.0) : 0.0, 2e-5);
            }
        }
    }

    // Several blocks of points, some of them on the borders of texels and of the patch.
    constexpr Index kCount = 200;
    std::vector<std::array<double, 3>> ways(at(2 * kCount));
    std::vector<std::array<double, 2>> places(at(kCount));
    for (Index p = 0; p < kCount; ++p) {
        std::copy_n(lights[at(p % 5)], 3, ways[at(p)].begin());
        std::copy_n(views[at(p / 5 % 5)], 3, ways[at(kCount + p)].begin());
        for (double& place : places[at(p)]) {
            place = p % 10 ? 5 * random.uniform() - 2.5 : static_cast<double>(p / 10 % 3 - 1);
        }
    }
    const std::span<const Vector3> all(reinterpret_cast<const Vector3*>(ways.data()), ways.size());
    const std::span<const double[2]> uv(reinterpret_cast<const double (*)[2]>(places.data()),
                                        places.size());
    std::vector<float> seen(at(kCount * t.channels), -1.0f);
    evaluator.points(executor, all.first(at(kCount)), all.last(at(kCount)), uv, seen.data());
    for (Index i = 0; i < kCount * t.channels; ++i) {
        const Index p = i / t.channels;
        const double x = uv[at(p)][0] * static_cast<double>(t.width) - 0.5;
        const double y = uv[at(p)][1] * static_cast<double>(t.height) - 0.5;
        double sum = 0;
        for (int corner = 0; corner < 4; ++corner) {
            const int dx = corner % 2, dy = corner / 2;
            const double weight =
                std::abs(1 - dx - (x - std::floor(x))) * std::abs(1 - dy - (y - std::floor(y)));
            sum +=
                weight * written_out(t, all[at(p)], all[at(kCount + p)], wrapped(y + dy, t.height),
                                     wrapped(x + dx, t.width), i % t.channels);
        }
        CHECK_NEAR(seen[at(i)], all[at(p)][2] > 0 ? std::max(sum, 0.0) : 0.0, 2e-5);
    }
    evaluator.points(executor, all.first(0), all.first(0), uv.first(0), nullptr);
}

// The kernels for any processor against those for this.
void compare_kernels() {
    Random random(3);
    const TableKernel &own = table_kernel(), &plain = table_kernel(true);
    const std::vector<float> core = numbers(7 * 2 * 400, random), rows = numbers(4 * 16, random);
    const std::vector<float> light = numbers(60, random);
    const std::array<const float*, 3> planes{core.data(), core.data() + 400, core.data() + 1200};
    for (Index texels : {1, 7, 8, 23, 100}) {
        std::vector<float> seen(at(texels)), expected(at(texels));
        own.quads({planes.data(), rows.data(), 3, texels, seen.data()});
        plain.quads({planes.data(), rows.data(), 3, texels, expected.data()});
        for (Index i = 0; i < texels; ++i) CHECK_NEAR(seen[at(i)], expected[at(i)], 1e-5);
    }
    const std::array<PointSums::Point, 2> points{
        PointSums::Point{core.data(), light.data(), {0, 4, 40, 44}},
        PointSums::Point{core.data() + 8, light.data() + 4, {36, 0, 76, 40}}};
    for (Index channels = 1; channels <= kPointChannels; ++channels) {
        for (Index rank = 1; rank <= 7; ++rank) {
            std::vector<float> seen(at(2 * channels * kPointLanes)), expected(seen.size());
            PointSums sums{points.data(), 2,        rows.data(), rank, 2,
                           400,           channels, 16,          8,    seen.data()};
            own.points(sums);
            sums.totals = expected.data();
            plain.points(sums);
            for (std::size_t i = 0; i < seen.size(); ++i) CHECK_NEAR(seen[i], expected[i], 1e-5);
        }
    }
}

void texels_of_directions() {
    const Vector3 up{0, 0, 1}, right{1, 0, 0}, back{0, -1, 0}, below{0, 0, -1}, under{0.6, 0, -0.8};
    CHECK(parabolic_texel(up, 256) == 128 * 256 + 128);
    CHECK(parabolic_texel(right, 256) == 128 * 256 + 255);
    CHECK(parabolic_texel(back, 256) == 256 + 128);
    CHECK(parabolic_texel(below, 256) == 128 * 256 + 128);
    CHECK(parabolic_texel(under, 256) == parabolic_texel(right, 256));
}

void wrong_tables() {
    const Owned owned = random_tables({1, 4, 1, 2, 5, 1, 3, 4, 6, 3, false, false}, 1);
    const auto message = [&](auto change) {
        Tables tables = owned.tables;
        change(tables);
        return message_of([&] { TableEvaluator evaluator(tables); });
    };
    CHECK(message([](Tables&) {}).empty());
    CHECK(message([](Tables& t) { t.light_rank = 0; }) ==
          "core: expected at least one rank and texel");
    CHECK(message([](Tables& t) { t.light = nullptr; }) ==
          "core: expected one light cluster and rank of occlusion");
    CHECK(message([](Tables& t) { t.light_owners = 3; }) == "light: expected 1 or 4 owners, got 3");
    CHECK(message([](Tables& t) { t.view_clusters = 1; }) ==
          "view_index: expected 1 to 1 mixtures (the clusters), got 2");
    CHECK(message([](Tables& t) { t.view_clusters = 3; }) ==
          "view_index: expected clusters below 3, got 3");
}

}  // namespace

int main() {
    // N-SVD, K-CTA of the view with and without lights of its own, of the light, and MK-CTA.
    compare({1, 1, 1, 1, 5, 2, 3, 4, 6, 3, false, false}, 1);
    compare({1, 4, 1, 2, 6, 1, 9, 131, 8, 3, false, false}, 2);
    compare({1, 4, 1, 3, 3, 1, 5, 5, 8, 4, true, false}, 3);
    compare({3, 1, 2, 1, 4, 2, 4, 1, 8, 1, false, true}, 4);
    compare({4, 5, 3, 3, 4, 1, 8, 8, 8, 3, true, true}, 5);
    compare({4, 5, 1, 2, 7, 1, 1, 9, 8, 2, false, false}, 6);
    compare({1, 3, 1, 2, 1, 2, 6, 7, 8, 1, false, false, false}, 7);
    compare_kernels();
    texels_of_directions();
    wrong_tables();
    std::puts("ok");
}
