// SPDX-License-Identifier: Apache-2.0
// The checks that a stored appearance has to pass.
#pragma once

#include <string>

#include "kernels/model/gaussian_state.h"

namespace gs {

/// "sh, max degree 3, relu"
std::string describe(const AppearanceSpec& spec);

/// Throws UsageError when a model read from `file` is not the one asked for: parameters of one appearance model mean
/// nothing to another.
void require_same_appearance(const AppearanceSpec& found, const AppearanceSpec& wanted, const std::string& file);

/// Appearance from the words of a file. Throws DataError naming the file for unknown names and impossible degrees.
AppearanceSpec appearance_from_file(const std::string& file, const std::string& model, std::int64_t max_degree,
                                    const std::string& activation);

/// Floats per Gaussian of a group under this appearance.
int group_width(Group group, const AppearanceSpec& spec);

}  // namespace gs
