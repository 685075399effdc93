// SPDX-License-Identifier: Apache-2.0
// Determines which GPUs can run the CUDA code of a build.
#include "kernels/cuda/device_code.h"

#include <cstdlib>
#include <sstream>

namespace gs {
namespace {

/// Oldest supported architecture: copies to shared memory that bypass registers, and products of half-precision tiles,
/// are new in Ampere.
constexpr int kOldest = 80;

/// Returns whether `entry` of the list, such as "sm_80", "sm_90a", "sm_120+PTX" or "compute_80", runs on `capability`.
bool runs_on(const std::string& entry, int capability) {
    const std::size_t digits = entry.find('_') + 1;
    if (digits == 0) return true;  // "native", "all": set at build time, so only trying a kernel shows it
    char* end = nullptr;
    const int built = int(std::strtol(entry.c_str() + digits, &end, 10));
    if (*end == 'a' || *end == 'f') return built == capability;
    if (entry.starts_with("compute_") || entry.ends_with("+PTX")) return built <= capability;
    return built / 10 == capability / 10 && built <= capability;
}

}  // namespace

std::string why_no_code(const std::string& architectures, const std::string& name, int major, int minor) {
    const int capability = 10 * major + minor;
    const std::string gpu = name + " (sm_" + std::to_string(capability) + ")";
    if (capability < kOldest)
        return gpu + " is older than the GPUs that gsapp supports: NVIDIA Ampere (sm_80) and later";
    std::istringstream entries(architectures);
    for (std::string entry; entries >> entry;)
        if (runs_on(entry, capability)) return "";
    return gpu + " cannot run this gsapp, which was built for " + architectures +
           "; build it for this GPU: cmake --preset release -DCMAKE_CUDA_ARCHITECTURES=" + std::to_string(capability) +
           " && cmake --build --preset release";
}

}  // namespace gs
