// SPDX-License-Identifier: Apache-2.0
// The instruction sets that the program was compiled for, and whether this machine has them.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Returns GSAPP_CPU_ARCH, the -march of the build ("native", "x86-64-v3").
const char* cpu_architecture();

/// Returns the instruction sets beyond x86-64 that the compiler was allowed to use, e.g. {"avx2", "fma"}.
std::vector<std::string> built_cpu_features();

/// Returns those of built_cpu_features() that this machine lacks. The program then ends by SIGILL sooner or later.
std::vector<std::string> missing_cpu_features();

}  // namespace gs
