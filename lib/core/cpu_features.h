// SPDX-License-Identifier: Apache-2.0
// The instruction sets that the program was compiled for.
#pragma once

#include <string>
#include <vector>

namespace gs {

inline constexpr const char* kCpuFeatures[] = {"avx",     "avx2",     "fma",      "bmi2",
                                               "avx512f", "avx512vl", "avx512bw", "avx512dq"};

/// Bit set of the instruction sets of the build: bit i is set if the compiler was allowed to use kCpuFeatures[i]. The
/// constant needs no dynamic initialisation, so it can be read at any time.
extern const unsigned kBuiltCpuFeatures;

/// Returns GSAPP_CPU_ARCH, the -march of the build ("native", "x86-64-v3").
const char* cpu_architecture();

/// Returns the names of kBuiltCpuFeatures, e.g. {"avx2", "fma"}.
std::vector<std::string> built_cpu_features();

}  // namespace gs
