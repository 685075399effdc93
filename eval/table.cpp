// SPDX-License-Identifier: Apache-2.0
// Reading results.json and laying out tables.
#include "eval/table.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "kernels/core/error.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

using Json = nlohmann::json;

using Cells = std::vector<std::string>;
constexpr std::size_t kFirstNumber = 5;  ///< columns from here on hold numbers and are aligned right

std::optional<std::int64_t> iteration_of(const std::string& key) {
    std::int64_t n = 0;
    if (!key.starts_with("ours_")) return std::nullopt;
    const auto [end, error] = std::from_chars(key.data() + 5, key.data() + key.size(), n);
    return error == std::errc() && end == key.data() + key.size() && n >= 0 ? std::optional(n) : std::nullopt;
}

double score(const Json& json, const std::string& file, const std::string& key, const char* name) {
    const Json& object = json.at(key);
    if (!object.is_object() || !object.contains(name)) throw DataError(fmt::format("{}: {} has no {}", file, key, name));
    const Json& value = object.at(name);
    if (value.is_null()) return std::numeric_limits<double>::infinity();
    if (!value.is_number()) throw DataError(fmt::format("{}: {}.{} is not a number: {}", file, key, name, value.dump()));
    return value.get<double>();
}

/// json[section][key], or null when any of it is missing.
Json fact(const Json& json, const char* section, const std::string& key) {
    const auto found = json.find(section);
    return found != json.end() && found->is_object() && found->contains(key) ? found->at(key) : Json();
}

std::string text_fact(const Json& object, const char* name) {
    return object.is_object() && object.contains(name) && object.at(name).is_string() ? object.at(name).get<std::string>() : "";
}

std::optional<double> number_fact(const Json& object, const char* name) {
    if (!object.is_object() || !object.contains(name) || !object.at(name).is_number()) return std::nullopt;
    return object.at(name).get<double>();
}

std::string duration(double seconds) {
    const auto whole = std::int64_t(std::lround(seconds));
    if (whole < 60) return fmt::format("{:.1f} s", seconds);
    if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
    return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
}

std::string or_dash(const std::string& text) { return text.empty() ? "-" : text; }

/// The further metrics that any row knows of, in the order of columns.
std::vector<MetricInfo> further_metrics(const std::vector<TableRow>& rows) {
    std::vector<MetricInfo> metrics;
    for (const MetricInfo& info : known_metrics()) {
        if (std::any_of(rows.begin(), rows.end(), [&](const TableRow& row) { return row.scores.contains(info.key); })) metrics.push_back(info);
    }
    return metrics;
}

Cells header(TableFormat format, const std::vector<MetricInfo>& metrics) {
    const bool csv = format == TableFormat::kCsv;
    Cells cells = csv ? Cells{"run", "scene", "model", "strategy", "ppisp", "num_gaussians", "psnr", "ssim"}
                      : Cells{"run", "scene", "model", "strategy", "ppisp", "#Gs", "PSNR", "SSIM"};
    for (const MetricInfo& info : metrics) cells.push_back(csv ? info.name : info.key);
    for (const char* name : {csv ? "train_seconds" : "train time", csv ? "peak_device_bytes" : "peak memory"}) cells.emplace_back(name);
    return cells;
}

std::string score_cell(const TableRow& row, const MetricInfo& info, bool csv) {
    const auto found = row.scores.find(info.key);
    if (found != row.scores.end() && found->second.value)
        return csv ? fmt::format("{}", *found->second.value) : fmt::format("{:.{}f}", *found->second.value, info.decimals);
    if (csv) return "";
    return found == row.scores.end() ? "-" : "not measured";
}

Cells cells_of(const TableRow& row, TableFormat format, const std::vector<MetricInfo>& metrics) {
    const bool csv = format == TableFormat::kCsv;
    const auto text = [&](const std::string& value) { return csv ? value : or_dash(value); };
    Cells cells = {text(row.run),        text(row.scene),
                   text(row.model),      text(row.strategy),
                   text(row.correction), text(row.num_gaussians ? fmt::format("{}", *row.num_gaussians) : ""),
                   csv ? fmt::format("{}", row.psnr) : fmt::format("{:.2f}", row.psnr),
                   csv ? fmt::format("{}", row.ssim) : fmt::format("{:.4f}", row.ssim)};
    for (const MetricInfo& info : metrics) cells.push_back(score_cell(row, info, csv));
    cells.push_back(text(!row.train_seconds ? "" : csv ? fmt::format("{}", *row.train_seconds) : duration(*row.train_seconds)));
    const auto peak = row.peak_device_bytes;
    cells.push_back(text(!peak ? "" : csv ? fmt::format("{}", *peak) : fmt::format("{:.2f} GiB", double(*peak) / (1 << 30))));
    return cells;
}

/// Why scores are missing, a line for each metric and reason.
std::string reasons(const std::vector<TableRow>& rows) {
    std::vector<std::string> lines;
    for (const MetricInfo& info : known_metrics()) {
        for (const TableRow& row : rows) {
            const auto found = row.scores.find(info.key);
            if (found == row.scores.end() || found->second.value) continue;
            const std::string line = fmt::format("{}: {}\n", info.key, found->second.reason);
            if (std::find(lines.begin(), lines.end(), line) == lines.end()) lines.push_back(line);
        }
    }
    std::string text;
    for (const std::string& line : lines) text += (text.empty() ? "\n" : "") + line;
    return text;
}

std::string markdown_escaped(const std::string& text) {
    std::string out;
    for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
    return out;
}

std::string csv_escaped(const std::string& text) {
    if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

std::string latex_escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '\\')
            out += "\\textbackslash{}";
        else if (c == '~')
            out += "\\textasciitilde{}";
        else if (c == '^')
            out += "\\textasciicircum{}";
        else if (std::string("&%$#_{}").find(c) != std::string::npos)
            out += std::string("\\") + c;
        else
            out += c;
    }
    return out;
}

std::string joined(const Cells& cells, const char* separator, std::string (*escape)(const std::string&)) {
    std::string line;
    for (const std::string& cell : cells) line += (&cell == &cells.front() ? "" : separator) + escape(cell);
    return line;
}

/// Columns padded to one width, so that the text reads as a table in a terminal, too.
std::string markdown(std::vector<Cells> lines) {
    std::vector<std::size_t> widths(lines.front().size());
    for (Cells& cells : lines) {
        for (std::size_t c = 0; c < widths.size(); ++c) {
            cells[c] = markdown_escaped(cells[c]);
            widths[c] = std::max({widths[c], cells[c].size(), std::size_t(3)});
        }
    }
    std::string text;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        text += "|";
        for (std::size_t c = 0; c < widths.size(); ++c)
            text += c < kFirstNumber ? fmt::format(" {:<{}} |", lines[i][c], widths[c]) : fmt::format(" {:>{}} |", lines[i][c], widths[c]);
        text += "\n";
        if (i > 0) continue;
        text += "|";
        for (std::size_t c = 0; c < widths.size(); ++c)
            text += c < kFirstNumber ? fmt::format(" {:-<{}} |", "", widths[c]) : fmt::format(" {:->{}} |", ":", widths[c]);
        text += "\n";
    }
    return text;
}

}  // namespace

TableFormat parse_table_format(const std::string& name) {
    if (name == "markdown") return TableFormat::kMarkdown;
    if (name == "csv") return TableFormat::kCsv;
    if (name == "latex") return TableFormat::kLatex;
    throw UsageError(fmt::format("--format: '{}' is not one of markdown, csv, latex", name));
}

TableRow read_table_row(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration) {
    const std::string file = RunFolder{run_folder}.results().string();
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throw DataError(fmt::format("{}: cannot be read; 'gsapp eval {}' writes it", file, run_folder.string()));
    const Json json = Json::parse(stream, nullptr, false);
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
    const auto folder = std::filesystem::absolute(run_folder).lexically_normal();  // also "." has a name
    row.run = (folder.has_filename() ? folder : folder.parent_path()).filename().string();
    row.iteration = *chosen;
    row.psnr = score(json, file, key, "PSNR");
    row.ssim = score(json, file, key, "SSIM");
    const Json missing = fact(json, "not_measured", key);
    for (const MetricInfo& info : known_metrics()) {
        if (info.key == "PSNR" || info.key == "SSIM") continue;
        if (json.at(key).contains(info.key))
            row.scores[info.key] = {score(json, file, key, info.key.c_str()), ""};
        else if (const std::string reason = text_fact(missing, info.key.c_str()); !reason.empty())
            row.scores[info.key] = {std::nullopt, reason};
    }
    const Json run = fact(json, "run", key), timing = fact(json, "timing", key), count = fact(json, "num_gaussians", key),
               memory = fact(json, "memory", key);
    row.scene = text_fact(run, "scene");
    row.model = text_fact(run, "model");
    row.strategy = text_fact(run, "strategy");
    row.correction = text_fact(fact(json, "protocol", key), "ppisp_eval");
    row.ssim_protocol = text_fact(fact(json, "protocol", key), "ssim");
    if (count.is_number_integer()) row.num_gaussians = count.get<std::int64_t>();
    row.train_seconds = number_fact(timing, "train_seconds");
    row.frame_seconds = number_fact(timing, "frame_seconds");
    if (memory.is_object() && memory.contains("peak_device_bytes") && memory.at("peak_device_bytes").is_number_integer())
        row.peak_device_bytes = memory.at("peak_device_bytes").get<std::int64_t>();
    return row;
}

std::string format_table(const std::vector<TableRow>& rows, TableFormat format) {
    const std::vector<MetricInfo> metrics = further_metrics(rows);
    std::vector<Cells> lines = {header(format, metrics)};
    for (const TableRow& row : rows) lines.push_back(cells_of(row, format, metrics));
    if (format == TableFormat::kMarkdown) return markdown(std::move(lines)) + reasons(rows);
    std::string text;
    if (format == TableFormat::kCsv) {
        for (const Cells& cells : lines) text += joined(cells, ",", csv_escaped) + "\n";
        return text;
    }
    text = "\\begin{tabular}{" + std::string(kFirstNumber, 'l') + std::string(lines[0].size() - kFirstNumber, 'r') + "}\n\\hline\n" + joined(lines[0], " & ", latex_escaped) + " \\\\\n\\hline\n";
    for (std::size_t i = 1; i < lines.size(); ++i) text += joined(lines[i], " & ", latex_escaped) + " \\\\\n";
    return text + "\\hline\n\\end{tabular}\n";
}

}  // namespace gs
