// SPDX-License-Identifier: Apache-2.0
// `--appearance auto`: short trainings on part of the training views, compared on the rest.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "eval/auto/appearance_choice.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct AppearanceReport {
    std::string model;               ///< what to train
    std::vector<std::string> lines;  ///< five, for people: what was done, what came out of it, and why; one where there was nothing to go by
    nlohmann::ordered_json json;     ///< the same for programs
};

/// Holds out every 8th training view, makes images at most 400 pixels wide and options.cap_max smaller in proportion, and trains `none` for a fifteenth of
/// options.iterations. Where residual_parts then finds direction to be worth more than options.auto_tolerance, goes on from there with each model of the
/// registry that is no variant, and chooses as choose_appearance does; otherwise it is `none`. Test views are not looked at. Takes at most half as long as
/// the run that would follow, as far as a trial's iterations tell: a trial that would exceed this, or does, has no result, and the report names it.
/// (What comes before the trials, and the first of them, always ends.) A scene with fewer than 8 training views, or whose masks leave nothing, gets `none`.
/// The same options and seed give the same choice unless time ran out. Throws what training throws.
AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene);

}  // namespace gs
