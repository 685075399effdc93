// SPDX-License-Identifier: Apache-2.0
// Reading results.json and laying out tables.
#include "eval/table.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
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

constexpr int kNumColumns = 10;
using Cells = std::array<std::string, kNumColumns>;
constexpr int kFirstNumber = 5;  ///< columns from here on hold numbers and are aligned right

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

Cells header(TableFormat format) {
    if (format == TableFormat::kCsv)
        return {"run", "scene", "model", "strategy", "ppisp", "num_gaussians", "psnr", "ssim", "train_seconds", "peak_device_bytes"};
    return {"run", "scene", "model", "strategy", "ppisp", "#Gs", "PSNR", "SSIM", "train time", "peak memory"};
}

Cells cells_of(const TableRow& row, TableFormat format) {
    const bool csv = format == TableFormat::kCsv;
    const auto count = row.num_gaussians ? fmt::format("{}", *row.num_gaussians) : "";
    if (csv) {
        return {row.run,
                row.scene,
                row.model,
                row.strategy,
                row.correction,
                count,
                fmt::format("{}", row.psnr),
                fmt::format("{}", row.ssim),
                row.train_seconds ? fmt::format("{}", *row.train_seconds) : "",
                row.peak_device_bytes ? fmt::format("{}", *row.peak_device_bytes) : ""};
    }
    return {or_dash(row.run),
            or_dash(row.scene),
            or_dash(row.model),
            or_dash(row.strategy),
            or_dash(row.correction),
            or_dash(count),
            fmt::format("{:.2f}", row.psnr),
            fmt::format("{:.4f}", row.ssim),
            row.train_seconds ? duration(*row.train_seconds) : "-",
            row.peak_device_bytes ? fmt::format("{:.2f} GiB", double(*row.peak_device_bytes) / (1 << 30)) : "-"};
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
    std::array<std::size_t, kNumColumns> widths{};
    for (Cells& cells : lines) {
        for (int c = 0; c < kNumColumns; ++c) {
            cells[c] = markdown_escaped(cells[c]);
            widths[c] = std::max({widths[c], cells[c].size(), std::size_t(3)});
        }
    }
    std::string text;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        text += "|";
        for (int c = 0; c < kNumColumns; ++c)
            text += c < kFirstNumber ? fmt::format(" {:<{}} |", lines[i][c], widths[c]) : fmt::format(" {:>{}} |", lines[i][c], widths[c]);
        text += "\n";
        if (i > 0) continue;
        text += "|";
        for (int c = 0; c < kNumColumns; ++c)
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
    std::vector<Cells> lines = {header(format)};
    for (const TableRow& row : rows) lines.push_back(cells_of(row, format));
    if (format == TableFormat::kMarkdown) return markdown(std::move(lines));
    std::string text;
    if (format == TableFormat::kCsv) {
        for (const Cells& cells : lines) text += joined(cells, ",", csv_escaped) + "\n";
        return text;
    }
    text = "\\begin{tabular}{lllllrrrrr}\n\\hline\n" + joined(lines[0], " & ", latex_escaped) + " \\\\\n\\hline\n";
    for (std::size_t i = 1; i < lines.size(); ++i) text += joined(lines[i], " & ", latex_escaped) + " \\\\\n";
    return text + "\\hline\n\\end{tabular}\n";
}

}  // namespace gs
