// SPDX-License-Identifier: Apache-2.0
// `--appearance auto`: measures, decides, describes.
#pragma once

#include <optional>
#include <string>

#include "eval/auto/appearance_report.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Measures models on the scene (measure_appearances), decides for one (decide_appearance, with options.auto_tolerance)
/// and says why (describe_appearance). Test views are not looked at. The same options and seed give the same choice
/// unless time ran out. Throws what training throws.
AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene);

/// Returns the model without residuals if held-out training views show that direction explains less than
/// options.auto_tolerance of what that model leaves; nothing otherwise, and where nothing can be measured. It takes the
/// first part of find_appearance, before the trials. Throws what training throws.
std::optional<std::string> appearance_for_no_direction(const TrainOptions& options, const Scene& scene);

}  // namespace gs
