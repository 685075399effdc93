// SPDX-License-Identifier: Apache-2.0
// Names of colour activations, and the checks a stored appearance has to pass.
#pragma once

#include <string>

#include "kernels/model/gaussian_state.h"
#include "lib/core/train_options.h"

namespace gs {

/// relu | softplus | sigmoid | hardsigmoid, as on the command line and in files.
const char* color_activation_name(ColorActivation activation);
/// Throws UsageError naming the known activations.
ColorActivation parse_color_activation(const std::string& name);

/// Returns the options' appearance as the kernels take it. Throws UsageError for unknown names.
AppearanceSpec appearance_spec(const TrainOptions& options);

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
