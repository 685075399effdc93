// SPDX-License-Identifier: Apache-2.0
// Which GPUs the CUDA code of a build runs on.
#pragma once

#include <string>

namespace gs {

/// Returns in one line why a GPU of compute capability major.minor cannot run code that was built for `architectures`
/// (as cuda_architectures() returns them), with the command that mends it; empty if it can. Machine code runs on GPUs
/// of the same major and no smaller minor number, PTX on all later ones. `name` is the GPU's. Source: CUDA C++
/// Programming Guide, "Application Compatibility".
std::string why_no_code(const std::string& architectures, const std::string& name, int major, int minor);

}  // namespace gs
