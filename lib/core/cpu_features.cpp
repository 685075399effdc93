// SPDX-License-Identifier: Apache-2.0
// Reads the compiler's macros.
#include "lib/core/cpu_features.h"

#include <iterator>

namespace gs {

const unsigned kBuiltCpuFeatures = 0
#ifdef __AVX__
                                   | 1u << 0
#endif
#ifdef __AVX2__
                                   | 1u << 1
#endif
#ifdef __FMA__
                                   | 1u << 2
#endif
#ifdef __BMI2__
                                   | 1u << 3
#endif
#ifdef __AVX512F__
                                   | 1u << 4
#endif
#ifdef __AVX512VL__
                                   | 1u << 5
#endif
#ifdef __AVX512BW__
                                   | 1u << 6
#endif
#ifdef __AVX512DQ__
                                   | 1u << 7
#endif
    ;

const char* cpu_architecture() { return GSAPP_CPU_ARCH; }

std::vector<std::string> built_cpu_features() {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < std::size(kCpuFeatures); ++i)
        if (kBuiltCpuFeatures >> i & 1) names.push_back(kCpuFeatures[i]);
    return names;
}

}  // namespace gs
