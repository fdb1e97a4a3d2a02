// The tables of a clustered Tucker model evaluated for any light and view, as a shader does it
// (K-CTA, Section 6.3.3; MK-CTA, Section 5.1): the rows and clusters of a direction are those of
// the parabolic map's texel nearest to it, and only these are read, with the core where it lies.
//
//   value[channel] = sum over k_l, k_v, r_l, r_v of
//     light[o(c_v), channel, k_l, r_l] * view[o(c_l), k_v, r_v] * core[c_l, c_v, r_l, r_v]
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

// Arrays in C order that somebody else holds. Ranks of the view, and of the light in its own map,
// come in quads filled up with zeros. Owners: 1, or the clusters of the other mode.
struct Tables {
    const float* core = nullptr;   // light x view clusters, light rank, view quads, y, x, 4
    const float* light = nullptr;  // owners, channels, mixtures, quads, size, size, 4; or null
    const float* view = nullptr;   // owners, mixtures, quads, size, size, 4
    const std::uint32_t* light_index = nullptr;  // mixtures, size, size
    const std::uint32_t* view_index = nullptr;
    Index light_clusters = 1, view_clusters = 1, light_rank = 1, view_quads = 1;
    Index height = 1, width = 1, size = 2;
    Index light_owners = 1, channels = 1, light_mixtures = 1;
    Index view_owners = 1, view_mixtures = 1;

    // Without a light (occlusion) the one number of the reduced vector is the value.
    bool lit() const { return light != nullptr; }
    Index light_quads() const { return (light_rank + 3) / 4; }
    Index map() const { return size * size; }
    Index plane() const { return height * width * 4; }  // floats of one quad for all texels
};

using Vector3 = double[3];

class TableEvaluator {
  public:
    // Throws std::invalid_argument unless the sizes fit together and the clusters exist.
    explicit TableEvaluator(const Tables& tables);

    const Tables& tables() const { return tables_; }

    // out[light][view][y][x][channel] at texel centres, not below 0, 0 for lights below the
    // horizon; of occlusion [view][y][x] as they are, with no lights. Directions are unit vectors
    // in the tangent frame.
    void patch(Executor& executor, std::span<const Vector3> lights, std::span<const Vector3> views,
               float* out) const;

    // out[point][channel] for as many lights, views and texture coordinates: bilinear between the
    // texels of a patch that repeats, not below 0, 0 for lights below the horizon.
    void points(Executor& executor, std::span<const Vector3> lights, std::span<const Vector3> views,
                std::span<const double[2]> uv, float* out) const;

  private:
    struct PatchWork;

    Tables tables_;
};

// The texel, row * size + column, of a parabolic map that is nearest to a unit direction; below the
// horizon the rim's.
Index parabolic_texel(const Vector3& direction, Index size);

}  // namespace nacre
