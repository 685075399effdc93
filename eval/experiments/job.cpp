// SPDX-License-Identifier: Apache-2.0
// Reads what a finished run left, and says how a run differs from the one in its folder.
#include "eval/experiments/job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "eval/report/table.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/model/run_folder.h"

namespace gs {

void set_folder(TrainOptions& options, const std::filesystem::path& folder) {
    options.model = folder.string();
    if (!options.tensorboard.empty())
        options.tensorboard = (std::filesystem::path(options.tensorboard) / folder.filename()).string();
}

nlohmann::ordered_json result_json(const JobResult& r) {
    nlohmann::ordered_json json;
    json["PSNR"] = std::isfinite(r.psnr) ? nlohmann::ordered_json(r.psnr) : nlohmann::ordered_json(nullptr);
    json["SSIM"] = r.ssim;
    json["num_gaussians"] = r.num_gaussians;
    json["train_seconds"] = r.train_seconds;
    json["frame_seconds"] = r.frame_seconds;
    json["bytes"] = r.bytes;
    if (r.peak_device_bytes) json["peak_device_bytes"] = *r.peak_device_bytes;
    return json;
}

std::optional<JobResult> finished_job(const TrainOptions& options) {
    const std::optional<TableRow> row = finished_run(options);
    if (!row || !row->num_gaussians || !row->frame_seconds) return std::nullopt;
    std::error_code ignored;
    std::uintmax_t bytes =
        std::filesystem::file_size(RunFolder{options.model}.point_cloud(ended_at(options).value_or(0)), ignored);
    if (options.size_limit) bytes = std::uintmax_t(row->planned_bytes.value_or(std::int64_t(bytes)));
    return JobResult{row->psnr,           row->ssim,           *row->num_gaussians,    *row->train_seconds,
                     *row->frame_seconds, std::int64_t(bytes), row->peak_device_bytes, row->protocol};
}

std::string difference_to_run(const TrainOptions& options) {
    TableRow run;
    read_training(run, options.model);
    if (run.training.empty()) return "";
    auto now = training_options(options);
    now["seed"] = std::to_string(options.seed), run.training["seed"] = std::to_string(run.seed);
    // The scene first: where it differs, so does more.
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
