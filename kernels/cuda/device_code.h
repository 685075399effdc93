// SPDX-License-Identifier: Apache-2.0
// Determines which GPUs can run the CUDA code of a build.
#pragma once

#include <string>

namespace gs {

/// Returns in one line why a GPU of compute capability major.minor cannot run code built for `architectures` (in the
/// format of cuda_architectures()), with the command that fixes it; empty if it can. Machine code runs on GPUs with the
/// same major number and at least the same minor number, PTX on all later GPUs. `name` is the GPU's name. Source: CUDA
/// C++ Programming Guide, "Application Compatibility".
std::string why_no_code(const std::string& architectures, const std::string& name, int major, int minor);

}  // namespace gs
