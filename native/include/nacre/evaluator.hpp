// Random access to a clustered Tucker model of a BTF: the values of single texels for one light and
// one view, as a shader computes them (Section 5.1 of the MK-CTA paper, "Rendering process").
//
// The y and x modes are expanded beforehand into a core texture. Its layout is texel-major: all
// that one texel may need lies together, a block of R_light x R_view floats for each combination of
// a light and a view cluster, blocks at multiples of 32 bytes. For one (light, view) a texel takes
// K_light K_view of them, which for MK-CTA with ranks of 4 are as many cache lines.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "nacre/executor.hpp"
#include "nacre/tensor.hpp"

namespace nacre {

class Evaluator {
  public:
    // The modes 0 to 3 are light rows, view, y, x; light row `channels * light + channel` is one
    // colour of one light. Arrays are in C order, finite, and only read by the constructor.
    struct Mode {
        Index clusters = 1;                      // C; 1 for a mode that is not clustered
        const std::uint32_t* members = nullptr;  // items x mixtures; null if not clustered
        const float* basis = nullptr;            // owners x rows x mixtures x rank
        // Owners: 1, or the combinations of the other clustered modes' clusters, last fastest.
        // The rows of one item (the colours of one light) share its clusters.
        Index owners = 1, rows = 0, mixtures = 1, rank = 0;
    };
    struct Model {
        const float* core = nullptr;  // product of the clusters x ranks
        std::array<Mode, 4> modes;
        Index channels = 1;
    };

    // Expands the y and x modes. The model must be consistent: see check().
    Evaluator(Executor& executor, const Model& model);

    // Throws std::invalid_argument unless the sizes of a model fit together and its members exist.
    static void check(const Model& model);

    Index lights() const { return light_.rows / channels_; }
    Index views() const { return view_.rows; }
    Index height() const { return height_; }
    Index width() const { return width_; }
    Index channels() const { return channels_; }

    // Core values that go into one texel: the product of all K and of R_light and R_view.
    Index reads() const { return slots_ * light_.mixtures * view_.mixtures * block_; }

    // Bytes of the core texture.
    Index bytes() const { return height_ * width_ * record_ * Index{sizeof(float)}; }

    // out[p][i][channel]: pair p of a light and a view at its i-th texel, y * width + x. `texels`
    // holds as many for each pair, or one list for all. Numbers must be in range.
    void decode(Executor& executor, std::span<const Index> lights, std::span<const Index> views,
                std::span<const Index> texels, bool shared_texels, float* out) const;

  private:
    // What is kept of the light and of the view mode.
    struct Rows {
        Index clusters, owners, rows, mixtures, rank;
        std::vector<float> basis;
        std::vector<std::uint32_t> members;  // items x mixtures; zeros if not clustered
    };
    struct Scratch;
    struct Free {
        void operator()(float* p) const;
    };

    static Rows keep(const Mode& mode, Index items);
    void expand(Executor& executor, const Model& model);
    void place(const Model& model);
    void weigh(Index light, Index view, Scratch& scratch) const;
    void decode_some(std::span<const Index> texels, const Scratch& scratch, float* out) const;

    Rows light_, view_;
    Index channels_, height_, width_;
    Index spatial_;                      // combinations of y and x clusters
    Index slots_;                        // of these a texel has so many
    Index block_;                        // R_light * R_view
    Index stride_;                       // the same in whole lanes
    Index record_;                       // floats of a texel
    std::vector<std::uint32_t> places_;  // texels x slots: the combination of y and x clusters
    std::unique_ptr<float[], Free> texture_;
};

}  // namespace nacre
