// SPDX-License-Identifier: Apache-2.0
// Ends the program with a message, instead of by SIGILL, if the CPU lacks required instructions. The check runs before
// all other initialisation, is compiled for any x86-64, and calls no code in other files, which are not.
#include <unistd.h>

#include "kernels/base/error.h"
#include "lib/core/cpu_features.h"

namespace gs {
namespace {

/// Returns bits as in kBuiltCpuFeatures. The compiler's function accepts only literals.
unsigned features_of_this_cpu() {
    __builtin_cpu_init();
    unsigned bits = 0;
    if (__builtin_cpu_supports("avx")) bits |= 1u << 0;
    if (__builtin_cpu_supports("avx2")) bits |= 1u << 1;
    if (__builtin_cpu_supports("fma")) bits |= 1u << 2;
    if (__builtin_cpu_supports("bmi2")) bits |= 1u << 3;
    if (__builtin_cpu_supports("avx512f")) bits |= 1u << 4;
    if (__builtin_cpu_supports("avx512vl")) bits |= 1u << 5;
    if (__builtin_cpu_supports("avx512bw")) bits |= 1u << 6;
    if (__builtin_cpu_supports("avx512dq")) bits |= 1u << 7;
    return bits;
}

void print(const char* text) {
    std::size_t length = 0;
    while (text[length] != '\0') ++length;
    if (::write(STDERR_FILENO, text, length) < 0) return;  // no other place to report the error
}

/// Checks the CPU at start. 101 is the first priority available to programs.
__attribute__((constructor(101))) void check_cpu() {
    const unsigned lacking = kBuiltCpuFeatures & ~features_of_this_cpu();
    if (lacking == 0) return;
    print("error: this CPU lacks what this gsapp was built for:");
    for (unsigned i = 0; i < sizeof(kCpuFeatures) / sizeof(kCpuFeatures[0]); ++i) {
        if ((lacking >> i & 1) == 0) continue;
        print(" ");
        print(kCpuFeatures[i]);
    }
    print("\nBuild it on this machine, or for others with -DGSAPP_CPU_ARCH=x86-64-v3.\n");
    ::_exit(static_cast<int>(ExitCode::kDevice));
}

}  // namespace
}  // namespace gs
