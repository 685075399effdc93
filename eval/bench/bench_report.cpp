// SPDX-License-Identifier: Apache-2.0
// Writes the measurements of a bench as text and as JSON.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "eval/bench/bench.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/train/memory_plan.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

/// A stage that takes longer than this many floors needs a reason.
constexpr double kWellAboveFloor = 3;

TextTable frame_table(const BenchResult& r) {
    TextTable table{.title = {}, .header = {"frames", "ms/frame", "FPS"}, .num_labels = 1};
    for (const FrameTime& f : r.frames)
        table.lines.push_back({{fmt::format("{}x{}, {} views", f.width, f.height, f.num_views)},
                               {fmt::format("{:.3f}", 1e3 * f.seconds)},
                               {fmt::format("{:.1f}", f.seconds > 0 ? 1 / f.seconds : 0)}});
    return table;
}

std::string iteration_lines(const BenchResult& r) {
    double sum = 0;
    for (const StageCost& s : r.stages) sum += s.seconds;
    std::string out = fmt::format(
        "iteration at {}x{}: {:.3f} ms (mean of {} in a row), {:.3f} ms (median of {} that are each waited for)\n",
        r.width, r.height, 1e3 * r.iteration_seconds, r.repeat, 1e3 * r.iteration_seconds_median, r.repeat);
    out += fmt::format("the stages add up to {:.3f} ms\n", 1e3 * sum);
    if (r.default_seconds && r.deterministic_seconds)
        out += fmt::format("with --deterministic {:.3f} ms, without {:.3f} ms: {:.2f} times\n",
                           1e3 * *r.deterministic_seconds, 1e3 * *r.default_seconds,
                           *r.deterministic_seconds / *r.default_seconds);
    return out;
}

/// The least times of a stage, in seconds.
struct Floor {
    double copy, fma;
    double seconds() const { return std::max(copy, fma); }
    const char* bound() const { return seconds() <= 0 ? "-" : copy > fma ? "copy" : "FMA"; }
};

Floor floor_of(const StageCost& s, const Ceilings& ceilings) {
    return {s.bytes / ceilings.copy_bytes_per_second, s.operations / ceilings.operations_per_second};
}

/// Returns the table of stages, with the reasons for long ones below it.
std::string stage_text(const char* title, const std::vector<StageCost>& stages, const Ceilings& ceilings,
                       TableStyle style) {
    TextTable table{
        .title = {},
        .header = {title, "items are", "bound by", "ms", "M items", "ns per item", "floor ms", "measured/floor"},
        .num_labels = 3};
    std::string reasons;
    for (const StageCost& s : stages) {
        const Floor floor = floor_of(s, ceilings);
        const double ratio = floor.seconds() > 0 ? s.seconds / floor.seconds() : 0;
        const bool above = ratio > kWellAboveFloor;
        table.lines.push_back({{s.stage},
                               {s.item},
                               {floor.bound()},
                               {fmt::format("{:.3f}", 1e3 * s.seconds)},
                               {fmt::format("{:.3g}", s.items / 1e6)},
                               {fmt::format("{:.3f}", s.items > 0 ? 1e9 * s.seconds / s.items : 0)},
                               {fmt::format("{:.3f}", 1e3 * floor.seconds())},
                               {floor.seconds() > 0 ? fmt::format("{:.1f}", ratio) : "-", "", above ? 1 : 0}});
        if (above) reasons += fmt::format("- {}: {}\n", s.stage, s.note.empty() ? "no reason is known" : s.note);
    }
    std::string text = table_text(table, style);
    if (!reasons.empty()) text += fmt::format("\nAbove {:.0f} floors:\n\n{}", kWellAboveFloor, reasons);
    return text;
}

std::vector<StageCost> appearance_shares(const BenchResult& r) {
    std::vector<StageCost> shares;
    for (std::size_t k = 0; k < r.stages.size() && !r.without_residual.empty(); ++k)
        if (r.stages[k].evaluates_appearance) shares.push_back(appearance_share(r, k));
    return shares;
}

Json json_of(const std::vector<StageCost>& stages, const Ceilings& ceilings) {
    Json json = Json::array();
    for (const StageCost& s : stages) {
        const Floor floor = floor_of(s, ceilings);
        json.push_back({{"stage", s.stage},
                        {"seconds", s.seconds},
                        {"items", s.items},
                        {"item", s.item},
                        {"bytes", s.bytes},
                        {"operations", s.operations},
                        {"floor_seconds", floor.seconds()},
                        {"bound_by", floor.seconds() > 0 ? Json(floor.bound()) : Json()}});
        if (!s.note.empty()) json.back()["note"] = s.note;
    }
    return json;
}

Json json_of(const BenchResult& r) {
    Json json = {{"subject", r.subject},
                 {"device", r.device},
                 {"num_gaussians", r.num_gaussians},
                 {"copy_bytes_per_second", r.ceilings.copy_bytes_per_second},
                 {"operations_per_second", r.ceilings.operations_per_second},
                 {"frames", Json::array()}};
    for (const FrameTime& f : r.frames)
        json["frames"].push_back(
            {{"width", f.width}, {"height", f.height}, {"num_views", f.num_views}, {"seconds", f.seconds}});
    json["iteration"] = {{"width", r.width},
                         {"height", r.height},
                         {"repeat", r.repeat},
                         {"seconds", r.iteration_seconds},
                         {"median_seconds", r.iteration_seconds_median}};
    if (r.default_seconds && r.deterministic_seconds)
        json["iteration"].update(
            {{"default_seconds", *r.default_seconds}, {"deterministic_seconds", *r.deterministic_seconds}});
    json["stages"] = json_of(r.stages, r.ceilings);
    json["appearance"] = json_of(appearance_shares(r), r.ceilings);
    if (r.memory.peak > 0) json["device_memory"] = {{"bytes", r.memory.bytes}, {"peak_bytes", r.memory.peak}};
    return json;
}

}  // namespace

std::string format_bench(const BenchResult& r, TableStyle style) {
    std::string out =
        fmt::format("{}\n{}; {} Gaussians; copy {:.1f} GB/s, {:.0f} G single-precision FMA/s\n\n", r.subject, r.device,
                    r.num_gaussians, r.ceilings.copy_bytes_per_second / 1e9, r.ceilings.operations_per_second / 1e9);
    out += table_text(frame_table(r), style) + "\n" + iteration_lines(r) + "\n";
    out += stage_text("stage", r.stages, r.ceilings, style);
    if (const std::vector<StageCost> shares = appearance_shares(r); !shares.empty())
        out += "\n" + stage_text("appearance in", shares, r.ceilings, style);
    if (r.memory.peak > 0) out += "\n" + memory_report(r.memory) + "\n";
    return out;
}

std::string bench_json(const std::vector<BenchResult>& results) {
    Json json = {{"program", version_text()}, {"results", Json::array()}};
    for (const BenchResult& result : results) json["results"].push_back(json_of(result));
    return json_text(json, 1) + "\n";
}

}  // namespace gs
