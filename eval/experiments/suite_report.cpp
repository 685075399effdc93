// SPDX-License-Identifier: Apache-2.0
// The runs of a suite as text and as JSON.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "eval/experiments/suite.h"
#include "eval/pages/escape.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

/// Returns the text as one field of the table: without line breaks and bars.
std::string table_field(const std::string& text) {
    std::string field = one_line(text);
    std::replace(field.begin(), field.end(), '|', '/');
    return field;
}

Json json_of(const SuiteLine& line) {
    Json json = {{"row", line.row}, {"appearance", line.appearance}, {"run", line.cell.options.model}};
    json["status"] = line.result ? "finished" : line.error.empty() ? "not trained" : "failed";
    if (!line.error.empty()) json["error"] = line.error;
    if (!line.result) return json;
    json.update(result_json(*line.result));
    return json;
}

}  // namespace

std::string format_suite(const std::vector<SuiteLine>& lines) {
    std::string out =
        "| run | appearance | PSNR | SSIM | #Gs | training, s | FPS | MB |\n|---|---|---:|---:|---:|---:|---:|---:|\n";
    for (const SuiteLine& line : lines) {
        out += fmt::format("| {} | {} |", line.row, line.appearance);
        if (line.result) {
            const CellResult& r = *line.result;
            out += fmt::format(" {:.2f} | {:.4f} | {} | {:.1f} | {:.1f} | {:.1f} |\n", r.psnr, r.ssim, r.num_gaussians,
                               r.train_seconds, r.frame_seconds > 0 ? 1 / r.frame_seconds : 0, 1e-6 * double(r.bytes));
        } else {
            out += fmt::format(" {} | | | | | |\n",
                               line.error.empty() ? "not trained" : "failed: " + table_field(line.error));
        }
    }
    return out;
}

void write_suite(const std::filesystem::path& folder, const std::string& suite, const std::vector<SuiteLine>& lines) {
    Json json = {{"suite", suite},
                 {"scene", lines.empty() ? "" : lines.front().cell.options.source},
                 {"program", version_text()},
                 {"runs", Json::array()}};
    for (const SuiteLine& line : lines) json["runs"].push_back(json_of(line));
    write_text_atomic(folder / "suite.md", format_suite(lines));
    write_text_atomic(folder / "suite.json", json_text(json, 1) + "\n");
}

}  // namespace gs
