// SPDX-License-Identifier: Apache-2.0
// Puts the answers of `gsapp --version` together.
#include "apps/gsapp/about.h"

#include "kernels/cuda/cuda_device.h"
#include "lib/core/cpu_features.h"
#include "lib/core/version.h"

namespace gs {

std::string version_report() {
    std::string text = version_text();
    const std::string no_cuda = try_cuda_device();
    if (no_cuda.empty())
        text += "\nbackends: cpu, cuda\ndevice: " + cuda_driver_description();
    else
        text += "\nbackends: cpu (cuda: " + no_cuda + ")";
    const std::string architectures = cuda_architectures();
    return architectures.empty() ? text : text + "\ncuda architectures: " + architectures;
}

nlohmann::ordered_json version_json() {
    nlohmann::ordered_json json = {{"version", version()},
                                   {"git_hash", git_hash()},
                                   {"cpu_architecture", cpu_architecture()},
                                   {"cpu_features", built_cpu_features()},
                                   {"cuda_architectures", cuda_architectures()},
                                   {"backends", {"cpu"}}};
    const std::string no_cuda = try_cuda_device();
    if (no_cuda.empty()) {
        json["backends"].push_back("cuda");
        json["device"] = cuda_driver_description();
    } else {
        json["no_cuda"] = no_cuda;
    }
    return json;
}

}  // namespace gs
