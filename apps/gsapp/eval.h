// SPDX-License-Identifier: Apache-2.0
// What `gsapp eval` does, for the commands that do the same under another name.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/gsapp/metrics.h"
#include "apps/gsapp/scene_arguments.h"
#include "eval/runs/protocol.h"

namespace gs {

struct EvalArguments {
    std::vector<std::string> runs;
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    std::string format;           ///< empty = Markdown, plainer on a terminal
    std::string protocol = protocols().front().name;
    std::string ssim_border, ppisp_eval, html, output;
    /// The views to score on instead of a run's own, and those of point clouds without a run; null: runs on their own.
    std::shared_ptr<SceneArguments> scene;
    int frame_rounds = 0;
    std::optional<int> marks;
    MetricArguments metrics{"psnr,ssim", ""};
    bool skip_render = false, decompose = false;
    bool json = false;
    int ranks = 1;
};

/// Adds the folders of runs, which may also stand after -m as in 3DGS's scripts. Returns the option.
CLI::Option* add_runs_option(CLI::App& command, std::vector<std::string>& runs, const std::string& positional,
                             const std::string& help = "Run folders", const std::string& type_name = "RUN");

/// Renders and scores the runs, and prints one table over all of them.
void run_eval(const EvalArguments& arguments);

}  // namespace gs
