// SPDX-License-Identifier: Apache-2.0
#include "lib/train/choose_backend.h"

#include <spdlog/spdlog.h>

#include "kernels/cuda_device.h"

namespace gs {

std::unique_ptr<Backend> choose_backend(const std::string& device, const AppearanceSpec& appearance) {
    const bool cuda = device == "cuda" || (device == "auto" && cuda_available());
    auto backend = cuda ? make_cuda_backend(appearance) : make_cpu_backend(appearance);
    const bool fallback = device == "auto" && !cuda;
    spdlog::info("device: {}{}", backend->describe(), fallback ? " (" + cuda_unavailable_reason() + ")" : "");
    return backend;
}

}  // namespace gs
