// SPDX-License-Identifier: Apache-2.0
// Whether this build and this machine can use CUDA.
#pragma once

#include <string>

namespace gs {

/// Compiled in, and a device answers.
bool cuda_available();

/// One line saying why cuda_available() is false ("built without CUDA", the driver's message).
std::string cuda_unavailable_reason();

}  // namespace gs
