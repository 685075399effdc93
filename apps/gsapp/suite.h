// SPDX-License-Identifier: Apache-2.0
// `gsapp bench --suite`: the runs of an experiment, one after another or one on each GPU.
#pragma once

#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

/// Trains the cells of a suite (eval/experiments/suite.h) that its folder `base.model` (empty: output/<scene>-<suite>) does not hold yet, as
/// processes of this program, and prints and writes the table. `base` as for suite_cells. A run that fails does not stop the
/// others. Throws Error with the exit code of the first run that failed, at the end; Interrupted after Ctrl-C, which ends the
/// runs under way and keeps those that are finished.
void run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base);

}  // namespace gs
