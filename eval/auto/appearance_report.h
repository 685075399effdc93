// SPDX-License-Identifier: Apache-2.0
// What `--appearance auto` says about its choice, for people and for programs.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "eval/auto/appearance_choice.h"

namespace gs {

struct AppearanceReport {
    std::string model;               ///< to train
    std::vector<std::string> lines;  ///< for people: five on what was done, what came out of it, and why; one where
                                     ///< nothing could be measured
    nlohmann::ordered_json json;     ///< the same for programs: auto.json
};

/// Returns why there are no measurements; measured.obstacle is set.
std::string obstacle_text(const AppearanceMeasurements& measured);

/// Describes a decision that was made from these measurements with this tolerance (dB).
AppearanceReport describe_appearance(const AppearanceMeasurements& measured, const AppearanceDecision& decision,
                                     double tolerance);

}  // namespace gs
