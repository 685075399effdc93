// SPDX-License-Identifier: Apache-2.0
// The runs of a suite as text and as JSON.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "eval/experiments/suite.h"
#include "eval/pages/escape.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const SuiteLine& line) {
    Json json = {{"row", line.row}, {"appearance", line.appearance}, {"run", line.cell.options.model}};
    json["status"] = line.result ? "finished" : line.error.empty() ? "not trained" : "failed";
    if (!line.error.empty()) json["error"] = line.error;
    if (!line.result) return json;
    json.update(result_json(*line.result));
    return json;
}

}  // namespace

std::string format_suite(const std::vector<SuiteLine>& lines, TableStyle style) {
    TextTable table{.title = {},
                    .header = {"run", "appearance", "PSNR", "SSIM", "#Gs", "training, s", "FPS", "MB"},
                    .num_labels = 2};
    std::string others;
    for (const SuiteLine& line : lines) {
        if (!line.result) {
            others += fmt::format("- {}, {}: {}\n", line.row, line.appearance,
                                  line.error.empty() ? "not trained" : "failed: " + one_line(line.error));
            continue;
        }
        const CellResult& r = *line.result;
        table.lines.push_back({{line.row},
                               {line.appearance},
                               {fmt::format("{:.2f}", r.psnr)},
                               {fmt::format("{:.4f}", r.ssim)},
                               {fmt::format("{}", r.num_gaussians)},
                               {fmt::format("{:.1f}", r.train_seconds)},
                               {fmt::format("{:.1f}", r.frame_seconds > 0 ? 1 / r.frame_seconds : 0)},
                               {fmt::format("{:.1f}", 1e-6 * double(r.bytes))}});
    }
    std::string text = table.lines.empty() ? "No run was trained to its end.\n" : table_text(table, style);
    if (!others.empty()) text += "\nWithout a result:\n\n" + others;
    return text;
}

std::string suite_json(const std::string& suite, const std::vector<SuiteLine>& lines) {
    Json json = {{"suite", suite},
                 {"scene", lines.empty() ? "" : lines.front().cell.options.source},
                 {"program", version_text()},
                 {"runs", Json::array()}};
    for (const SuiteLine& line : lines) json["runs"].push_back(json_of(line));
    return json_text(json, 1) + "\n";
}

void write_suite(const std::filesystem::path& folder, const std::string& suite, const std::vector<SuiteLine>& lines) {
    write_text_atomic(folder / "suite.md", format_suite(lines));
    write_text_atomic(folder / "suite.json", suite_json(suite, lines));
}

}  // namespace gs
