// SPDX-License-Identifier: Apache-2.0
// What this build of the program is, and which devices it can use here.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace gs {

/// Returns version, backends, and what CUDA was built for and found, or why there is none.
std::string version_report();

/// Returns the same for programs, and the instruction sets that the build needs.
nlohmann::ordered_json version_json();

}  // namespace gs
