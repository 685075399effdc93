// SPDX-License-Identifier: Apache-2.0
// Reads the files of a finished run, and describes how options differ from those of the run in their folder.
#include "eval/experiments/job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "eval/runs/results.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/model/run_folder.h"

namespace gs {

void set_folder(TrainOptions& options, const std::filesystem::path& folder) {
    options.model = folder.string();
    if (!options.tensorboard.empty())
        options.tensorboard = (std::filesystem::path(options.tensorboard) / folder.filename()).string();
}

nlohmann::ordered_json job_json(const RunResult& result) {
    return result_json(
        result, {"PSNR", "SSIM", "num_gaussians", "train_seconds", "frame_seconds", "bytes", "peak_device_bytes"});
}

std::optional<RunResult> finished_job(const TrainOptions& options) {
    std::optional<RunResult> result = finished_run(options);
    if (!result || !result->num_gaussians || !result->frame_seconds) return std::nullopt;
    std::error_code ignored;
    result->bytes = std::int64_t(
        std::filesystem::file_size(RunFolder{options.model}.point_cloud(ended_at(options).value_or(0)), ignored));
    const auto planned = nlohmann::ordered_json::json_pointer("/size/bytes");
    if (options.size_limit && result->plan.contains(planned) && result->plan[planned].is_number_integer())
        result->bytes = result->plan[planned].get<std::int64_t>();
    return result;
}

std::string difference_to_run(const TrainOptions& options) {
    RunResult run;
    read_training(run, options.model);
    if (run.training.empty()) return "";
    auto now = training_options(options);
    now["seed"] = std::to_string(options.seed), run.training["seed"] = std::to_string(run.seed);
    // Compares the scene first: if it differs, so do other options.
    std::string text = now["source"] != run.training["source"]
                           ? fmt::format("source {}, now {}", run.training["source"], now["source"])
                           : "";
    for (const auto& [key, value] : now)
        if (text.empty() && run.training[key] != value)
            text = fmt::format("{} {}, now {}", key, run.training[key], value);
    return text;
}

void require_named_appearance(const TrainOptions& options) {
    if (options.appearance == kAutoAppearance)
        throw UsageError(
            "appearance auto: every run that is compared would choose a model of its own; let one run of gsapp train "
            "--appearance auto choose it, "
            "then name it here");
}

void limit_budget(TrainOptions& options, double share) {
    options.cap_max = std::max<std::int64_t>(1, std::llround(share * double(options.cap_max)));
    options.init_points = std::min(options.init_points, options.cap_max);
}

}  // namespace gs
