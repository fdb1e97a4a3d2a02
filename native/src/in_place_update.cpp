#include "in_place_update.hpp"

#include <algorithm>

namespace nacre {

bool can_update_in_place(const ClusterState& state) {
    const bool others = std::any_of(state.ranks().begin() + state.clustered(), state.ranks().end(),
                                    [](Index r) { return r > 0; });
    return state.clustered() == 1 ? others : !others;
}

void update_in_place(Executor& executor, ClusterState& state, Index c, Tensor& residual,
                     ResidualScratch& scratch) {
    const auto update = state.clustered() == 1 ? update_one_mode : update_several_modes;
    update(executor, state, c, residual, scratch);
}

}  // namespace nacre
