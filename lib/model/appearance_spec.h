// SPDX-License-Identifier: Apache-2.0
// The names of colour activations, and checks of the appearance that a file stores.
#pragma once

#include <string>

#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"

namespace gs {

/// Returns the options' appearance as the kernels take it. Throws UsageError for unknown names.
AppearanceSpec appearance_spec(const AppearanceOptions& options);

/// Describes the appearance for messages: "sh, max degree 3, relu".
std::string describe(const AppearanceSpec& spec);

/// Throws UsageError when the model read from `file` is not the wanted one: the parameters of one appearance model mean
/// nothing to another.
void require_same_appearance(const AppearanceSpec& found, const AppearanceSpec& wanted, const std::string& file);

/// Makes an appearance from the words of a file. Throws DataError naming the file for unknown names and impossible
/// degrees.
AppearanceSpec appearance_from_file(const std::string& file, const std::string& model, std::int64_t max_degree,
                                    const std::string& activation);

/// Returns the number of floats per Gaussian of a group under this appearance.
int group_width(Group group, const AppearanceSpec& spec);

}  // namespace gs
