// SPDX-License-Identifier: Apache-2.0
// Which device a model runs on.
#pragma once

#include <string>

#include "kernels/backend.h"

namespace gs {

/// `device`: "cpu", "cuda", or "auto" (CUDA where there is one, else the CPU; one line of the log says which and why).
/// Throws DeviceError for "cuda" without a device.
std::unique_ptr<Backend> choose_backend(const std::string& device, const AppearanceSpec& appearance);

}  // namespace gs
