// SPDX-License-Identifier: Apache-2.0
// Reads results.json and config.yaml of a run.
#include "eval/report/table.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>
#include <nlohmann/json.hpp>

#include "eval/runs/protocol.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

std::optional<std::int64_t> iteration_of(const std::string& key) {
    std::int64_t n = 0;
    if (!key.starts_with("ours_")) return std::nullopt;
    const auto [end, error] = std::from_chars(key.data() + 5, key.data() + key.size(), n);
    return error == std::errc() && end == key.data() + key.size() && n >= 0 ? std::optional(n) : std::nullopt;
}

double score(const nlohmann::json& json, const std::string& file, const std::string& key, const std::string& name) {
    const nlohmann::json& object = json.at(key);
    if (!object.is_object() || !object.contains(name))
        throw DataError(fmt::format("{}: {} has no {}", file, key, name));
    const nlohmann::json& value = object.at(name);
    if (value.is_null()) return std::numeric_limits<double>::infinity();
    if (!value.is_number())
        throw DataError(fmt::format("{}: {}.{} is not a number: {}", file, key, name, json_text(value)));
    return value.get<double>();
}

/// Returns json[section][key], or null when either is missing.
nlohmann::json fact(const nlohmann::json& json, const char* section, const std::string& key) {
    const auto found = json.find(section);
    return found != json.end() && found->is_object() && found->contains(key) ? found->at(key) : nlohmann::json();
}

std::string text_fact(const nlohmann::json& object, const char* name) {
    return object.is_object() && object.contains(name) && object.at(name).is_string()
               ? object.at(name).get<std::string>()
               : "";
}

std::optional<std::int64_t> count_fact(const nlohmann::json& object, const char* name) {
    if (!object.is_object() || !object.contains(name) || !object.at(name).is_number_integer()) return std::nullopt;
    return object.at(name).get<std::int64_t>();
}

std::optional<double> number_fact(const nlohmann::json& object, const char* name) {
    if (!object.is_object() || !object.contains(name) || !object.at(name).is_number()) return std::nullopt;
    return object.at(name).get<double>();
}

/// Returns the frame times; empty unless all of their numbers are there.
std::optional<FrameTimes> frame_times_fact(const nlohmann::json& object) {
    const auto views = count_fact(object, "num_views"), frames = count_fact(object, "frames_per_view");
    const auto mean = number_fact(object, "mean_seconds"), median = number_fact(object, "median_seconds"),
               min = number_fact(object, "min_seconds"), max = number_fact(object, "max_seconds");
    if (!views || !frames || !mean || !median || !min || !max) return std::nullopt;
    return FrameTimes{text_fact(object, "device"), int(*views), int(*frames), *mean, *median, *min, *max};
}

}  // namespace

TableRow read_table_row(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration) {
    const std::string file = RunFolder{run_folder}.results().string();
    if (const std::string fault = input_fault(file); !fault.empty())
        throw DataError(
            fmt::format("{}: cannot be read: {}; 'gsapp eval {}' writes it", file, fault, run_folder.string()));
    const nlohmann::json json = try_parse_json(read_input(file));
    if (!json.is_object()) throw DataError(fmt::format("{}: not a JSON object", file));
    std::optional<std::int64_t> chosen;
    for (const auto& [key, value] : json.items()) {
        const auto n = iteration_of(key);
        if (n && (iteration ? *n == *iteration : !chosen || *n > *chosen)) chosen = n;
    }
    if (!chosen && iteration) throw DataError(fmt::format("{}: iteration {} was not evaluated", file, *iteration));
    if (!chosen) throw DataError(fmt::format("{}: no 'ours_<iteration>' entry", file));
    const std::string key = fmt::format("ours_{}", *chosen);
    TableRow row;
    row.folder = run_folder;
    std::error_code ignored;
    const auto folder =
        std::filesystem::absolute(run_folder, ignored).lexically_normal();  // so that "." has a name, too
    row.run = (folder.has_filename() ? folder : folder.parent_path()).filename().string();
    row.iteration = *chosen;
    row.psnr = score(json, file, key, "PSNR");
    row.ssim = score(json, file, key, "SSIM");
    for (const auto& [name, value] : json.at(key).items())
        if (name != "PSNR" && name != "SSIM" && value.is_number()) row.further_metrics[name] = value.get<double>();
    const nlohmann::json run = fact(json, "run", key), timing = fact(json, "timing", key),
                         count = fact(json, "num_gaussians", key), protocol = fact(json, "protocol", key),
                         not_measured = fact(json, "not_measured", key);
    for (const auto& [name, reason] : not_measured.items())
        if (reason.is_string()) row.not_measured[name] = reason.get<std::string>();
    row.dataset = text_fact(run, "dataset");
    row.scene = text_fact(run, "scene");
    row.model = text_fact(run, "model");
    row.strategy = text_fact(run, "strategy");
    row.residual_share = number_fact(run, "residual_share");
    row.bytes_per_gaussian = count_fact(run, "bytes_per_gaussian");
    row.ply_bytes_per_gaussian = count_fact(run, "ply_bytes_per_gaussian");
    row.web_bytes_per_gaussian = count_fact(run, "web_bytes_per_gaussian");
    row.correction = text_fact(protocol, "ppisp_eval");
    row.protocol_name = text_fact(protocol, "name");
    if (!row.protocol_name.empty() && !is_protocol(row.protocol_name))
        throw DataError(
            fmt::format("{}: protocol.{}.name '{}' is not known to this version", file, key, row.protocol_name));
    row.protocol = text_fact(protocol, "line");
    if (count.is_number_integer()) row.num_gaussians = count.get<std::int64_t>();
    row.train_seconds = number_fact(timing, "train_seconds");
    row.frame_seconds = number_fact(timing, "frame_seconds");
    row.frame_times = frame_times_fact(fact(json, "frame_times", key));
    row.peak_device_bytes = count_fact(fact(json, "memory", key), "peak_device_bytes");
    const auto plan = fact(json, "plan", key);
    if (plan.contains("size")) row.planned_bytes = count_fact(plan["size"], "bytes");
    return row;
}

void read_training(TableRow& row, const std::filesystem::path& run_folder) {
    try {
        const TrainOptions options = load_run_options(run_folder);
        row.seed = options.seed;
        row.training = training_options(options);
    } catch (const Error&) {  // the folder is of another program or version
    }
}

bool holds_same_run(const TrainOptions& options) {
    TableRow row;
    read_training(row, options.model);
    return !row.training.empty() && row.seed == options.seed && row.training == training_options(options);
}

std::optional<TableRow> finished_run(const TrainOptions& options) {
    const RunFolder folder{options.model};
    const auto last = ended_at(options);
    if (!last || !holds_same_run(options)) return std::nullopt;
    try {
        TableRow row = read_table_row(folder.root, *last);
        read_training(row, folder.root);
        return row.train_seconds ? std::optional(row) : std::nullopt;  // the time is written last
    } catch (const DataError&) {  // the results are of another iteration or cut short
        return std::nullopt;
    }
}

void require_one_protocol(const std::vector<TableRow>& rows) {
    const auto other =
        std::find_if(rows.begin(), rows.end(), [&](const TableRow& row) { return row.protocol != rows[0].protocol; });
    if (other == rows.end()) return;
    std::string message = "scores of different protocols do not compare; evaluate the runs again with one --protocol:";
    for (const TableRow& row : rows)
        message +=
            fmt::format("\n  {}: {}", row.run, row.protocol.empty() ? "protocol not stated by the file" : row.protocol);
    throw UsageError(message);
}

}  // namespace gs
