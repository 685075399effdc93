// SPDX-License-Identifier: Apache-2.0
// Appearance specifications from options and files, and checks against the registered appearance models.
#pragma once

#include <string>

#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"

namespace gs {

/// Returns the AppearanceSpec for the kernels from the options. Throws UsageError for unknown names.
AppearanceSpec appearance_spec(const AppearanceOptions& options);

/// Describes the appearance for messages: "sh, max degree 3, relu".
std::string describe(const AppearanceSpec& spec);

/// Throws UsageError if the appearance found in `file` is not the wanted one: the parameters of one appearance model
/// have no meaning in another.
void require_same_appearance(const AppearanceSpec& found, const AppearanceSpec& wanted, const std::string& file);

/// Makes an AppearanceSpec from the names in a file. Throws DataError naming the file for unknown names and
/// impossible degrees.
AppearanceSpec appearance_from_file(const std::string& file, const std::string& model, std::int64_t max_degree,
                                    const std::string& activation);

/// Returns the number of floats per Gaussian of a parameter group with this appearance.
int group_width(Group group, const AppearanceSpec& spec);

}  // namespace gs
