#include <algorithm>
#include <limits>

#include "dictionary.hpp"
#include "largest.hpp"
#include "nacre/ensemble.hpp"
#include "nacre/errors.hpp"

namespace nacre {

namespace {

// How many of the coefficients, in order of importance, leave at most `allowed`; what they leave.
std::pair<std::size_t, double> needed(const std::vector<Coefficient>& kept, double squared_norm,
                                      double allowed) {
    double left = squared_norm;
    std::size_t count = 0;
    for (; count < kept.size() && left > allowed; ++count) {
        left -= static_cast<double>(kept[count].value) * kept[count].value;
    }
    return {count, std::max(0.0, left)};
}

}  // namespace

SparseCode code(Executor& executor, const Patches& patches, const Ensemble& ensemble,
                Index sparsity, double error) {
    require(sparsity >= 1 && sparsity <= patches.size(), "sparsity: expected 1 to ", patches.size(),
            " (the values of a patch), got ", sparsity);
    require(error >= 0, "error: expected 0 or more, got ", error);
    const std::size_t count = at(patches.count()), room = at(sparsity);
    SparseCode result;
    result.sparsity = sparsity;
    result.positions.assign(count * room, 0);
    result.values.assign(count * room, 0);
    result.counts.assign(count, 0);
    result.members.assign(count, 0);
    result.errors.assign(count, 0);
    std::vector<PatchBuffers> buffers = patch_buffers(executor, patches);
    executor.stage(0, 1, "Coding patches");
    executor.parallel_for(
        patches.count(),
        [&](Index patch, int worker) {
            PatchBuffers& own = buffers[at(worker)];
            const double norm = patches.read(patch, own.patch.data());
            const double allowed = error * static_cast<double>(patches.size());
            std::vector<Coefficient> kept;
            std::size_t fewest = std::numeric_limits<std::size_t>::max();
            double least = 0;
            for (std::size_t k = 0; k < ensemble.size(); ++k) {
                const Projected p = project(patches.shape(), ensemble[k], -1, own);
                largest(p.values, patches.size(), sparsity, kept);
                sort_by_importance(kept);
                const auto [some, left] = needed(kept, norm, allowed);
                if (some > fewest || (some == fewest && left >= least)) continue;
                fewest = some;
                least = left;
                result.members[at(patch)] = static_cast<std::uint32_t>(k);
                result.counts[at(patch)] = static_cast<std::uint32_t>(some);
                result.errors[at(patch)] = left;
                for (std::size_t i = 0; i < room; ++i) {
                    const bool used = i < some;
                    result.positions[at(patch) * room + i] = used ? kept[i].position : 0;
                    result.values[at(patch) * room + i] = used ? kept[i].value : 0;
                }
            }
        },
        true);
    return result;
}

}  // namespace nacre
