#include "kernels.hpp"

namespace nacre {

const Kernels* kernels() {
#if defined(__x86_64__)
    static const Kernels* const best = []() -> const Kernels* {
        const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
        if (avx2 && __builtin_cpu_supports("avx512f")) return &kKernelsAvx512;
        return avx2 ? &kKernelsAvx2 : nullptr;
    }();
    return best;
#else
    return nullptr;
#endif
}

}  // namespace nacre
