// SPDX-License-Identifier: Apache-2.0
// Merges scores into the JSON files of a run.
#include "eval/runs/results.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

Json existing(const std::filesystem::path& path) {
    if (!path_exists(path)) return Json::object();
    Json json = try_parse_ordered_json(read_input(path));
    if (!json.is_object())
        throw DataError(fmt::format("{}: not a JSON object; remove it to have it written anew", path.string()));
    return json;
}

/// Returns the object under `key` and makes one where there is none.
Json& section(Json& json, const char* key) {
    if (!json[key].is_object()) json[key] = Json::object();
    return json[key];
}

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

}  // namespace

void write_results(const RunFolder& folder, const EvalOptions& options, const EvalResult& result,
                   const RunFacts& facts) {
    const std::string key = fmt::format("ours_{}", options.iteration);
    Json results = existing(folder.results());
    results[key] = {{"SSIM", result.ssim}, {"PSNR", finite_or_null(result.psnr)}};
    for (const auto& [name, score] : result.scores) {
        if (score.value) results[key][name] = finite_or_null(*score.value);
    }
    const bool aligned = options.correction.mode == CorrectionMode::kColourAligned ||
                         options.correction.mode == CorrectionMode::kSceneAligned;
    const Protocol& protocol = options.protocol;
    const std::string rounding = protocol.eight_bit ? "8 bits: " : "float: ",
                      steps = protocol.eight_bit ? ", *255, +0.5, truncated" : "";
    section(results, "protocol")[key] = {
        {"name", protocol.name},
        {"line", protocol_line(protocol, facts.background)},
        {"images", rounding + (aligned ? "aligned to the photographs, " : "") + "clamped to [0,1]" + steps +
                       "; no crop, no mask" + (aligned ? "" : ", no colour alignment")},
        {"image_source", protocol.images},
        {"ppisp_eval", correction_name(options.correction.mode)},
        {"photometric", describe_correction(options.correction)},
        {"psnr", "10 log10(1/MSE) over all pixels and channels, mean over images; null = identical images"},
        {"ssim", describe_ssim(protocol.ssim_border) + ", mean over images"},
        {"lpips", fmt::format("{}, inputs in {}", lpips_metric(protocol.lpips_net),
                              protocol.lpips_range == LpipsRange::kSymmetric ? "[-1,1]" : "[0,1]")},
        {"background", {facts.background.x, facts.background.y, facts.background.z}},
        {"split", facts.split_rule},
        {"num_views", result.views.size()},
        {"program", version_text()},
    };
    for (const Metric& metric : options.metrics)
        results["protocol"][key][metric.info.name] = metric.protocol + ", mean over images";
    // The reasons of this evaluation replace earlier ones.
    section(results, "not_measured").erase(key);
    for (const auto& [name, score] : result.scores) {
        if (!score.value) results["not_measured"][key][name] = score.reason;
    }
    if (results["not_measured"].empty()) results.erase("not_measured");
    Json& timing = section(section(results, "timing"), key.c_str());
    if (facts.train_seconds) timing["train_seconds"] = *facts.train_seconds;
    if (facts.controller_seconds) timing["controller_seconds"] = *facts.controller_seconds;
    if (facts.frame_seconds) timing["frame_seconds"] = *facts.frame_seconds;
    timing["render_seconds"] = result.render_seconds;
    if (facts.peak_device_bytes) section(results, "memory")[key] = {{"peak_device_bytes", *facts.peak_device_bytes}};
    if (!facts.photometric.empty()) section(results, "photometric")[key] = {{"decision", facts.photometric}};
    if (!facts.appearance_choice.is_null()) section(results, "appearance_choice")[key] = facts.appearance_choice;
    if (!facts.plan.is_null()) section(results, "plan")[key] = facts.plan;
    if (result.residual_mean)
        section(results, "decomposition")[key] = {{"residual_mean", finite_or_null(*result.residual_mean)}};
    section(results, "num_gaussians")[key] = facts.num_gaussians;
    section(results, "run")[key] = {{"dataset", facts.dataset},
                                    {"scene", facts.scene},
                                    {"model", facts.model},
                                    {"strategy", facts.strategy},
                                    {"bytes_per_gaussian", facts.bytes_per_gaussian},
                                    {"ply_bytes_per_gaussian", facts.ply_bytes_per_gaussian},
                                    {"frame", frame_json(facts.frame)}};
    if (facts.web_bytes_per_gaussian) results["run"][key]["web_bytes_per_gaussian"] = *facts.web_bytes_per_gaussian;
    if (facts.residual_share < 1) results["run"][key]["residual_share"] = facts.residual_share;

    Json per_view = existing(folder.per_view());
    Json scores = {{"SSIM", Json::object()}, {"PSNR", Json::object()}}, names = Json::object(),
         residuals = Json::object();
    for (std::size_t i = 0; i < result.views.size(); ++i) {
        const std::string file = folder.render(options.split, options.iteration, int(i)).filename().string();
        scores["SSIM"][file] = result.views[i].ssim;
        scores["PSNR"][file] = finite_or_null(result.views[i].psnr);
        for (const auto& [name, score] : result.views[i].scores) {
            if (score.value) scores[name][file] = finite_or_null(*score.value);
        }
        names[file] = result.views[i].name;
        if (result.views[i].residual_mean) residuals[file] = finite_or_null(*result.views[i].residual_mean);
    }
    per_view[key] = scores;
    if (result.residual_mean) section(per_view, "decomposition")[key] = {{"residual_mean", residuals}};
    section(per_view, "image_names")[key] = names;
    write_text_atomic(folder.per_view(), json_text(per_view, 1) + "\n");
    write_text_atomic(folder.results(), json_text(results, 1) + "\n");
}

void write_frame_times(const RunFolder& folder, std::int64_t iteration, const FrameTimes& times) {
    Json results = existing(folder.results());
    section(results, "frame_times")[fmt::format("ours_{}", iteration)] = {
        {"protocol", kFrameProtocol},   {"device", times.device},
        {"num_views", times.num_views}, {"frames_per_view", times.frames_per_view},
        {"mean_seconds", times.mean},   {"median_seconds", times.median},
        {"min_seconds", times.min},     {"max_seconds", times.max}};
    write_text_atomic(folder.results(), json_text(results, 1) + "\n");
}

}  // namespace gs
