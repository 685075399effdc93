// SPDX-License-Identifier: Apache-2.0
// Merges results into the JSON files of a run, and reads these files together with config.yaml.
#include "eval/runs/results.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "eval/runs/protocol.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

std::string key_of(std::int64_t iteration) { return fmt::format("ours_{}", iteration); }

std::optional<std::int64_t> iteration_of(const std::string& key) {
    std::int64_t n = 0;
    if (!key.starts_with("ours_")) return std::nullopt;
    const auto [end, error] = std::from_chars(key.data() + 5, key.data() + key.size(), n);
    return error == std::errc() && end == key.data() + key.size() && n >= 0 ? std::optional(n) : std::nullopt;
}

Json existing(const std::filesystem::path& path) {
    if (!path_exists(path)) return Json::object();
    Json json = try_parse_ordered_json(read_input(path));
    if (!json.is_object())
        throw DataError(fmt::format("{}: not a JSON object; remove it to have it written anew", path.string()));
    return json;
}

/// Returns the object under `key`, creating it if there is none.
Json& section(Json& json, const std::string& key) {
    if (!json[key].is_object()) json[key] = Json::object();
    return json[key];
}

void write_field(Json& results, const RunResult& result, const ResultField& field) {
    const std::optional<Json> value = field_json(result, field);
    if (!value || !field.section) return;
    const std::string part = field.section, key = key_of(result.iteration);
    if (part.empty())
        results[key][field.name] = *value;
    else if (part == field.name)
        section(results, part)[key] = *value;
    else
        section(section(results, part), key)[field.name] = *value;
}

/// Returns the stored value of a field; null if there is none.
const Json* stored(const Json& results, const std::string& key, const ResultField& field) {
    if (!field.section) return nullptr;
    const std::string part = field.section;
    if (part.empty()) return find_member(find_member(&results, key), field.name);
    const Json* of_iteration = find_member(find_member(&results, part), key);
    return part == field.name ? of_iteration : find_member(of_iteration, field.name);
}

void write_per_view(const RunFolder& folder, const RunResult& result) {
    const std::string key = key_of(result.iteration);
    Json per_view = existing(folder.per_view());
    Json scores = {{"SSIM", Json::object()}, {"PSNR", Json::object()}}, names = Json::object(),
         residuals = Json::object();
    for (std::size_t i = 0; i < result.views.size(); ++i) {
        const ViewScore& view = result.views[i];
        const std::string file = folder.render("test", result.iteration, int(i)).filename().string();
        scores["SSIM"][file] = view.ssim;
        scores["PSNR"][file] = finite_or_null(view.psnr);
        for (const auto& [name, score] : view.scores)
            if (score.value) scores[name][file] = finite_or_null(*score.value);
        names[file] = view.name;
        if (view.residual_mean) residuals[file] = finite_or_null(*view.residual_mean);
    }
    per_view[key] = scores;
    if (result.residual_mean) section(per_view, "decomposition")[key] = {{"residual_mean", residuals}};
    section(per_view, "image_names")[key] = names;
    write_text_atomic(folder.per_view(), json_text(per_view, 1) + "\n");
}

}  // namespace

void write_results(const RunFolder& folder, const RunResult& result) {
    const std::string key = key_of(result.iteration);
    Json results = existing(folder.results());
    results[key] = {{"SSIM", nullptr}, {"PSNR", nullptr}};  // in the order of 3DGS
    section(results, "protocol");
    section(results, "not_measured").erase(key);  // the reasons of this evaluation replace earlier ones
    for (const auto& [name, score] : result.scores) {
        if (score.value)
            results[key][name] = finite_or_null(*score.value);
        else
            results["not_measured"][key][name] = score.reason;
    }
    if (results["not_measured"].empty()) results.erase("not_measured");
    if (find_member(find_member(&results, "run"), key)) results["run"][key] = Json::object();
    for (const ResultField& field : result_fields()) write_field(results, result, field);
    write_per_view(folder, result);
    write_text_atomic(folder.results(), json_text(results, 1) + "\n");
}

void write_frame_times(const RunFolder& folder, std::int64_t iteration, const FrameTimes& times) {
    Json results = existing(folder.results());
    RunResult result;
    result.iteration = iteration;
    result.frame_times = times;
    write_field(results, result, result_field("frame_times"));
    write_text_atomic(folder.results(), json_text(results, 1) + "\n");
}

RunResult read_results(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration) {
    const std::string file = RunFolder{run_folder}.results().string();
    if (const std::string fault = input_fault(file); !fault.empty())
        throw DataError(
            fmt::format("{}: cannot be read: {}; 'gsapp eval {}' writes it", file, fault, run_folder.string()));
    const Json json = try_parse_ordered_json(read_input(file));
    if (!json.is_object()) throw DataError(fmt::format("{}: not a JSON object", file));
    std::optional<std::int64_t> chosen;
    for (const auto& [key, value] : json.items()) {
        const auto n = iteration_of(key);
        if (n && (iteration ? *n == *iteration : !chosen || *n > *chosen)) chosen = n;
    }
    if (!chosen && iteration) throw DataError(fmt::format("{}: iteration {} was not evaluated", file, *iteration));
    if (!chosen) throw DataError(fmt::format("{}: no 'ours_<iteration>' entry", file));
    const std::string key = key_of(*chosen);
    RunResult result;
    result.folder = run_folder;
    std::error_code ignored;
    const auto folder =
        std::filesystem::absolute(run_folder, ignored).lexically_normal();  // so that "." gets a name, too
    result.run = (folder.has_filename() ? folder : folder.parent_path()).filename().string();
    result.iteration = *chosen;
    for (const ResultField& field : result_fields()) {
        const Json* value = stored(json, key, field);
        if ((value && read_field(result, field, *value)) || !field.required()) continue;
        if (!value) throw DataError(fmt::format("{}: {} has no {}", file, key, field.name));
        throw DataError(fmt::format("{}: {}.{} is not a number: {}", file, key, field.name, json_text(*value)));
    }
    for (const auto& [name, value] : json.at(key).items())
        if (name != "PSNR" && name != "SSIM" && value.is_number()) result.scores[name].value = value.get<double>();
    if (const Json* reasons = find_member(find_member(&json, "not_measured"), key))
        for (const auto& [name, reason] : reasons->items())
            if (reason.is_string()) result.scores[name].reason = reason.get<std::string>();
    if (const std::string name = result.protocol_name(); !name.empty() && !is_protocol(name))
        throw DataError(fmt::format("{}: protocol.{}.name '{}' is not known to this version", file, key, name));
    return result;
}

void read_training(RunResult& result, const std::filesystem::path& run_folder) {
    try {
        const TrainOptions options = load_run_options(run_folder);
        result.seed = options.seed;
        result.training = training_options(options);
    } catch (const Error&) {  // the folder belongs to another program or version
    }
}

bool holds_same_run(const TrainOptions& options) {
    RunResult run;
    read_training(run, options.model);
    return !run.training.empty() && run.seed == options.seed && run.training == training_options(options);
}

std::optional<RunResult> finished_run(const TrainOptions& options) {
    const RunFolder folder{options.model};
    const auto last = ended_at(options);
    if (!last || !holds_same_run(options)) return std::nullopt;
    try {
        RunResult result = read_results(folder.root, *last);
        read_training(result, folder.root);
        return result.train_seconds ? std::optional(result) : std::nullopt;  // the time is written last
    } catch (const DataError&) {  // the results are of another iteration or truncated
        return std::nullopt;
    }
}

}  // namespace gs
