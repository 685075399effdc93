// SPDX-License-Identifier: Apache-2.0
// Lists the fields, and converts their values to JSON and back.
#include "eval/runs/run_result.h"

#include <limits>
#include <stdexcept>

#include "lib/core/json_text.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

bool read(const Json& json, double& value) {
    if (!json.is_number() && !json.is_null()) return false;
    value = json.is_null() ? std::numeric_limits<double>::infinity() : json.get<double>();
    return true;
}

bool read(const Json& json, std::string& value) {
    if (json.is_string()) value = json.get<std::string>();
    return json.is_string();
}

bool read(const Json& json, std::optional<double>& value) {
    if (json.is_number()) value = json.get<double>();
    return json.is_number();
}

bool read(const Json& json, std::optional<std::int64_t>& value) {
    if (json.is_number_integer()) value = json.get<std::int64_t>();
    return json.is_number_integer();
}

bool read(const Json& json, std::optional<std::string>& value) {
    return json.is_string() && read(json, value.emplace());
}

bool read(const Json& json, Json& value) {
    value = json;
    return true;
}

/// Reads frame times; fails if one of their numbers is missing.
bool read(const Json& json, std::optional<FrameTimes>& value) {
    FrameTimes times;
    const auto count = [&](const char* name, int& number) {
        const Json* found = find_member(&json, name);
        if (!found || !found->is_number_integer()) return false;
        number = int(found->get<std::int64_t>());
        return true;
    };
    const auto seconds = [&](const char* name, double& number) {
        const Json* found = find_member(&json, name);
        return found && found->is_number() && read(*found, number);
    };
    if (!count("num_views", times.num_views) || !count("frames_per_view", times.frames_per_view) ||
        !seconds("mean_seconds", times.mean) || !seconds("median_seconds", times.median) ||
        !seconds("min_seconds", times.min) || !seconds("max_seconds", times.max))
        return false;
    if (const Json* device = find_member(&json, "device")) read(*device, times.device);
    value = times;
    return true;
}

std::optional<Json> json_of(double value) { return finite_or_null(value); }
std::optional<Json> json_of(std::int64_t value) { return Json(value); }
std::optional<Json> json_of(const std::string& value) { return Json(value); }
std::optional<Json> json_of(const Json& value) { return value.is_null() ? std::nullopt : std::optional(value); }
std::optional<Json> json_of(const FrameTimes& times) {
    return Json{{"protocol", kFrameProtocol},   {"device", times.device},
                {"num_views", times.num_views}, {"frames_per_view", times.frames_per_view},
                {"mean_seconds", times.mean},   {"median_seconds", times.median},
                {"min_seconds", times.min},     {"max_seconds", times.max}};
}
template <class T> std::optional<Json> json_of(const std::optional<T>& value) {
    return value ? json_of(*value) : std::nullopt;
}

std::string text_at(const Json& object, const char* key) {
    std::string text;
    if (const Json* found = find_member(&object, key)) read(*found, text);
    return text;
}

}  // namespace

std::string RunResult::protocol_name() const { return text_at(protocol, "name"); }

std::string RunResult::protocol_line() const { return text_at(protocol, "line"); }

std::string RunResult::correction() const { return text_at(protocol, "ppisp_eval"); }

std::optional<double> RunResult::fps() const {
    return frame_seconds && *frame_seconds > 0 ? std::optional(1 / *frame_seconds) : std::nullopt;
}

const std::vector<ResultField>& result_fields() {
    using R = RunResult;
    static const std::vector<ResultField> fields = {
        {"PSNR", "", &R::psnr},
        {"SSIM", "", &R::ssim},
        {"protocol", "protocol", &R::protocol},
        {"train_seconds", "timing", &R::train_seconds},
        {"controller_seconds", "timing", &R::controller_seconds},
        {"frame_seconds", "timing", &R::frame_seconds},
        {"render_seconds", "timing", &R::render_seconds},
        {"peak_device_bytes", "memory", &R::peak_device_bytes},
        {"decision", "photometric", &R::photometric},
        {"refine_cameras", "refine_cameras", &R::refine_cameras},
        {"appearance_choice", "appearance_choice", &R::appearance_choice},
        {"plan", "plan", &R::plan},
        {"residual_mean", "decomposition", &R::residual_mean},
        {"aligned_psnr", "aligned_cameras", &R::aligned_psnr},
        {"aligned_ssim", "aligned_cameras", &R::aligned_ssim},
        {"aligned_pixels", "aligned_cameras", &R::aligned_pixels},
        {"num_gaussians", "num_gaussians", &R::num_gaussians},
        {"dataset", "run", &R::dataset},
        {"scene", "run", &R::scene},
        {"model", "run", &R::model},
        {"strategy", "run", &R::strategy},
        {"bytes_per_gaussian", "run", &R::bytes_per_gaussian},
        {"ply_bytes_per_gaussian", "run", &R::ply_bytes_per_gaussian},
        {"frame", "run", &R::frame},
        {"web_bytes_per_gaussian", "run", &R::web_bytes_per_gaussian},
        {"residual_share", "run", &R::residual_share},
        {"frame_times", "frame_times", &R::frame_times},
        {"bytes", nullptr, &R::bytes},
    };
    return fields;
}

const ResultField& result_field(const std::string& name) {
    for (const ResultField& field : result_fields())
        if (field.name == name) return field;
    throw std::logic_error("a result has no field " + name);
}

std::optional<double> field_number(const RunResult& result, const ResultField& field) {
    const std::optional<Json> value = field_json(result, field);
    return value && value->is_number() ? std::optional(value->get<double>()) : std::nullopt;
}

std::optional<Json> field_json(const RunResult& result, const ResultField& field) {
    return std::visit([&](auto member) { return json_of(result.*member); }, field.member);
}

bool read_field(RunResult& result, const ResultField& field, const Json& value) {
    return std::visit([&](auto member) { return read(value, result.*member); }, field.member);
}

Json result_json(const RunResult& result, std::initializer_list<const char*> names) {
    Json json = Json::object();
    for (const char* name : names)
        if (const std::optional<Json> value = field_json(result, result_field(name))) json[name] = *value;
    return json;
}

}  // namespace gs
