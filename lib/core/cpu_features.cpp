// SPDX-License-Identifier: Apache-2.0
// Compares the compiler's macros with what the CPU says.
#include "lib/core/cpu_features.h"

namespace gs {
namespace {

struct Feature {
    const char* name;
    bool is_here;
};

/// A feature that the machine has and the compiler may not use is left out: it changes nothing.
std::vector<Feature> built_features() {
    __builtin_cpu_init();
    std::vector<Feature> features;
#ifdef __AVX__
    features.push_back({"avx", __builtin_cpu_supports("avx") != 0});
#endif
#ifdef __AVX2__
    features.push_back({"avx2", __builtin_cpu_supports("avx2") != 0});
#endif
#ifdef __FMA__
    features.push_back({"fma", __builtin_cpu_supports("fma") != 0});
#endif
#ifdef __BMI2__
    features.push_back({"bmi2", __builtin_cpu_supports("bmi2") != 0});
#endif
#ifdef __AVX512F__
    features.push_back({"avx512f", __builtin_cpu_supports("avx512f") != 0});
#endif
#ifdef __AVX512VL__
    features.push_back({"avx512vl", __builtin_cpu_supports("avx512vl") != 0});
#endif
#ifdef __AVX512BW__
    features.push_back({"avx512bw", __builtin_cpu_supports("avx512bw") != 0});
#endif
#ifdef __AVX512DQ__
    features.push_back({"avx512dq", __builtin_cpu_supports("avx512dq") != 0});
#endif
    return features;
}

}  // namespace

const char* cpu_architecture() { return GSAPP_CPU_ARCH; }

std::vector<std::string> built_cpu_features() {
    std::vector<std::string> names;
    for (const Feature& feature : built_features()) names.push_back(feature.name);
    return names;
}

std::vector<std::string> missing_cpu_features() {
    std::vector<std::string> names;
    for (const Feature& feature : built_features())
        if (!feature.is_here) names.push_back(feature.name);
    return names;
}

}  // namespace gs
