// SPDX-License-Identifier: Apache-2.0
// Lists the columns and their values, groups runs into tables and lines, and averages repeated runs.
#include "eval/report/comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "eval/metrics/metrics.h"
#include "kernels/base/error.h"
#include "lib/core/quantities.h"

namespace gs {
namespace {

std::string two_digits(double v) { return fmt::format("{:.2f}", v); }
std::string four_digits(double v) { return fmt::format("{:.4f}", v); }
std::string whole(double v) { return fmt::format("{:.0f}", v); }
std::string one_digit(double v) { return fmt::format("{:.1f}", v); }
std::string percent(double v) { return fmt::format("{:.1f} %", 100 * v); }
std::string gibibytes(double v) { return fmt::format("{:.2f} GiB", v / double(1 << 30)); }

/// Returns the metrics in column order. 3DGS's metrics.py writes "LPIPS" without naming the net.
std::vector<MetricInfo> column_metrics() {
    std::vector<MetricInfo> metrics = known_metrics();
    const auto flip =
        std::find_if(metrics.begin(), metrics.end(), [](const MetricInfo& info) { return info.name == "flip"; });
    metrics.insert(flip, {"lpips", "LPIPS", false, 4});
    return metrics;
}

Column cost_column(const char* name, const char* title, Better better, std::string (*text)(double),
                   std::vector<ColumnUnit> units = {}) {
    return {name, title, better, text, &result_field(name), std::move(units)};
}

const std::vector<Column>& cost_columns() {
    static const std::vector<Column> columns = {
        cost_column("residual_share", "residuals", Better::kNeither, percent, {{"%", 100, 1}}),
        cost_column("bytes_per_gaussian", "bytes/G", Better::kLower, whole),
        cost_column("ply_bytes_per_gaussian", "PLY B/G", Better::kLower, whole),
        cost_column("web_bytes_per_gaussian", "web B/G", Better::kLower, whole),
        cost_column("num_gaussians", "#Gs", Better::kNeither, whole),
        cost_column("train_seconds", "train time", Better::kLower, duration_text,
                    {{"s", 1, 1}, {"min", 1 / 60.0, 1}, {"h", 1 / 3600.0, 2}}),
        cost_column("peak_device_bytes", "peak memory", Better::kLower, gibibytes, {{"GiB", 1 / double(1 << 30), 2}}),
        {"fps", "FPS", Better::kHigher, one_digit, &result_field("frame_seconds")}};
    return columns;
}

using Sample = std::vector<std::optional<double>>;  ///< one value per column

bool same_experiment(const RunResult& a, const RunResult& b) {
    if (a.training.empty() || a.scene != b.scene || a.correction() != b.correction() || a.training != b.training)
        return false;
    // Under a time limit the number of iterations varies by chance.
    const auto limit = a.training.find("time-limit");
    return a.iteration == b.iteration || (limit != a.training.end() && !limit->second.empty());
}

std::string label_of(const std::vector<RunResult>& runs) {
    if (runs.size() == 1) return runs[0].run;
    return fmt::format("{} .. {} ({} runs)", runs.front().run, runs.back().run, runs.size());
}

Sample sample_of(const RunResult& run, const std::vector<Column>& columns) {
    Sample sample;
    for (const Column& column : columns) sample.push_back(column_value(column, run));
    return sample;
}

std::vector<Sample> samples_of(const ComparisonLine& line, const std::vector<Column>& columns) {
    std::vector<Sample> samples;
    for (const RunResult& run : line.runs) samples.push_back(sample_of(run, columns));
    return samples;
}

/// Returns the statistics of every column. A column that one run lacks is empty, because readers would take the mean of
/// the other runs for that of all runs.
std::vector<std::optional<ColumnStats>> stats_of(const std::vector<Sample>& samples,
                                                 const std::vector<Column>& columns) {
    std::vector<std::optional<ColumnStats>> stats;
    for (std::size_t c = 0; c < columns.size(); ++c) {
        std::vector<double> values;
        for (const Sample& sample : samples)
            if (sample[c]) values.push_back(*sample[c]);
        stats.push_back(values.size() == samples.size() ? std::optional(column_stats(values, columns[c].better))
                                                        : std::nullopt);
    }
    return stats;
}

/// Returns the mean of each element; empty if an element is empty in one of the samples.
Sample mean_sample(const std::vector<Sample>& samples) {
    Sample mean(samples[0].size(), 0.0);
    for (const Sample& sample : samples)
        for (std::size_t c = 0; c < mean.size(); ++c)
            mean[c] =
                mean[c] && sample[c] ? std::optional(*mean[c] + *sample[c] / double(samples.size())) : std::nullopt;
    return mean;
}

std::vector<std::uint64_t> seeds_of(const ComparisonLine& line) {
    std::vector<std::uint64_t> seeds;
    for (const RunResult& run : line.runs) seeds.push_back(run.seed);
    return seeds;
}

/// Returns the line of a dataset computed from lines of its scenes.
ComparisonLine dataset_line(const std::vector<const ComparisonLine*>& scenes, const std::vector<Column>& columns) {
    ComparisonLine line = *scenes[0];
    line.num_scenes = scenes.size();
    line.label = fmt::format("mean of {} scenes", scenes.size());
    const bool paired = std::all_of(scenes.begin(), scenes.end(),
                                    [&](const ComparisonLine* s) { return seeds_of(*s) == seeds_of(line); });
    const std::size_t num_runs = paired ? line.runs.size() : 1;
    std::vector<Sample> runs;
    for (std::size_t k = 0; k < num_runs; ++k) {
        std::vector<Sample> per_scene;
        for (const ComparisonLine* scene : scenes) {
            const std::vector<Sample> all = samples_of(*scene, columns);
            per_scene.push_back(paired ? all[k] : mean_sample(all));
        }
        runs.push_back(mean_sample(per_scene));
    }
    line.num_runs = num_runs;
    if (num_runs > 1) line.label += fmt::format(", {} runs each", num_runs);
    line.values = stats_of(runs, columns);
    for (std::size_t k = 1; k < scenes.size(); ++k)
        line.runs.insert(line.runs.end(), scenes[k]->runs.begin(), scenes[k]->runs.end());
    return line;
}

/// Returns the displayed names of a line; lines with equal names look like the same experiment.
std::tuple<std::string, std::string, std::string> look_of(const ComparisonLine& line) {
    return {line.model, line.strategy, line.correction};
}

/// Adds to every line the options that distinguish it from lines with the same displayed names.
void name_options(ComparisonTable& table) {
    std::map<std::tuple<std::string, std::string, std::string>, std::vector<ComparisonLine*>> looks;
    for (ComparisonLine& line : table.lines) looks[look_of(line)].push_back(&line);
    for (const auto& [look, lines] : looks) {
        std::set<std::string> keys;
        for (const ComparisonLine* line : lines)
            for (const auto& [key, text] : line->runs[0].training) {
                const auto& other = lines[0]->runs[0].training;
                if (const auto found = other.find(key); found == other.end() || found->second != text) keys.insert(key);
            }
        for (ComparisonLine* line : lines)
            for (const std::string& key : keys) {
                const auto found = line->runs[0].training.find(key);
                if (found == line->runs[0].training.end()) continue;
                line->options += fmt::format("{}{} {}", line->options.empty() ? "" : ", ", key, found->second);
            }
    }
}

void give_places(ComparisonTable& table, const std::vector<Column>& columns) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
        if (columns[c].better == Better::kNeither) continue;
        std::vector<ColumnStats*> stats;
        for (ComparisonLine& line : table.lines)
            if (line.values[c] && line.num_scenes == table.num_scenes) stats.push_back(&*line.values[c]);
        const double sign = columns[c].better == Better::kHigher ? -1 : 1;
        std::stable_sort(stats.begin(), stats.end(),
                         [&](const ColumnStats* a, const ColumnStats* b) { return sign * a->mean < sign * b->mean; });
        const auto text = [&](const ColumnStats* s) { return columns[c].text(s->mean); };
        // There is no best value if all lines show the same value, or if there is only one line.
        if (stats.empty() || text(stats.front()) == text(stats.back())) continue;
        int place = 1;
        for (std::size_t i = 0; i < stats.size(); ++i) {
            if (i > 0 && text(stats[i]) != text(stats[i - 1])) place = int(i) + 1;
            if (place > 3) break;
            stats[i]->place = place;
        }
    }
}

std::vector<ComparisonLine> grouped(const std::vector<RunResult>& runs) {
    std::vector<ComparisonLine> lines;
    for (const RunResult& run : runs) {
        const auto same = std::find_if(lines.begin(), lines.end(),
                                       [&](const ComparisonLine& line) { return same_experiment(line.runs[0], run); });
        if (same == lines.end()) {
            ComparisonLine line;
            line.runs = {run};
            line.model = run.model, line.strategy = run.strategy, line.correction = run.correction();
            lines.push_back(line);
        } else {
            same->runs.push_back(run);
        }
    }
    for (ComparisonLine& line : lines) {
        std::stable_sort(line.runs.begin(), line.runs.end(),
                         [](const RunResult& a, const RunResult& b) { return a.seed < b.seed; });
        line.label = label_of(line.runs);
        line.num_runs = line.runs.size();
    }
    return lines;
}

/// Returns the tables of datasets with several scenes.
std::vector<ComparisonTable> dataset_tables(const std::vector<ComparisonTable>& scenes,
                                            const std::vector<Column>& columns) {
    std::vector<std::string> order;
    for (const ComparisonTable& scene : scenes)
        if (std::find(order.begin(), order.end(), scene.dataset) == order.end()) order.push_back(scene.dataset);
    std::vector<ComparisonTable> tables;
    for (const std::string& dataset : order) {
        ComparisonTable table{dataset, "", 0, {}};
        std::vector<std::vector<const ComparisonLine*>> matches;
        for (const ComparisonTable& scene : scenes) {
            if (scene.dataset != dataset) continue;
            ++table.num_scenes;
            std::set<std::size_t> taken;  // matches of this scene; a second line of one look and options starts its own
            for (const ComparisonLine& line : scene.lines) {
                std::size_t k = 0;
                while (k < matches.size() && (taken.count(k) > 0 || look_of(*matches[k][0]) != look_of(line) ||
                                              matches[k][0]->options != line.options))
                    ++k;
                if (k == matches.size()) matches.emplace_back();
                matches[k].push_back(&line);
                taken.insert(k);
            }
        }
        if (dataset.empty() || table.num_scenes < 2) continue;
        for (const auto& match : matches) table.lines.push_back(dataset_line(match, columns));
        give_places(table, columns);
        tables.push_back(std::move(table));
    }
    return tables;
}

/// Throws UsageError naming runs and protocols unless all runs have the same protocol, or all have none.
void require_one_protocol(const std::vector<RunResult>& runs) {
    if (std::all_of(runs.begin(), runs.end(),
                    [&](const RunResult& run) { return run.protocol_line() == runs[0].protocol_line(); }))
        return;
    std::string message = "scores of different protocols do not compare; evaluate the runs again with one --protocol:";
    for (const RunResult& run : runs) {
        const std::string line = run.protocol_line();
        message += fmt::format("\n  {}: {}", run.run, line.empty() ? "protocol not stated by the file" : line);
    }
    throw UsageError(message);
}

}  // namespace

std::vector<Column> table_columns(const std::vector<RunResult>& runs) {
    std::set<std::string> wanted = {"PSNR", "SSIM"};
    for (const RunResult& run : runs)
        for (const auto& [name, score] : run.scores) wanted.insert(name);
    std::vector<Column> columns;
    for (const MetricInfo& m : column_metrics())
        if (wanted.erase(m.key) > 0)
            columns.push_back({m.key, m.key, m.higher_is_better ? Better::kHigher : Better::kLower,
                               m.decimals == 2 ? two_digits : four_digits});
    for (const std::string& name : wanted) columns.push_back({name, name, Better::kNeither, four_digits});
    columns.insert(columns.end(), cost_columns().begin(), cost_columns().end());
    return columns;
}

const ColumnUnit& column_unit(const Column& column, double largest) {
    const ColumnUnit* unit = &column.units.front();
    for (const ColumnUnit& other : column.units)
        if (largest * other.factor >= 2) unit = &other;
    return *unit;
}

std::optional<double> column_value(const Column& column, const RunResult& result) {
    if (column.key == "fps") return result.fps();
    if (column.cost) return field_number(result, *column.cost);
    if (column.key == "PSNR") return result.psnr;
    if (column.key == "SSIM") return result.ssim;
    const auto found = result.scores.find(column.key);
    return found == result.scores.end() ? std::nullopt : found->second.value;
}

ColumnStats column_stats(const std::vector<double>& values, Better better) {
    ColumnStats stats;
    const double n = double(values.size());
    for (const double v : values) stats.mean += v / n;
    stats.worst = stats.mean;
    if (better != Better::kNeither) {
        const auto worst = better == Better::kHigher ? std::min_element(values.begin(), values.end())
                                                     : std::max_element(values.begin(), values.end());
        stats.worst = *worst;
        stats.worst_run = std::size_t(worst - values.begin());
    }
    if (values.size() < 2 || !std::isfinite(stats.mean)) return stats;
    double squares = 0;
    for (const double v : values) squares += (v - stats.mean) * (v - stats.mean);
    stats.deviation = std::sqrt(squares / (n - 1));
    return stats;
}

Comparison compare_runs(const std::vector<RunResult>& runs) {
    require_one_protocol(runs);
    std::set<std::filesystem::path> folders;
    for (const RunResult& run : runs) {
        std::error_code ignored;
        if (!run.folder.empty() && !folders.insert(std::filesystem::weakly_canonical(run.folder, ignored)).second)
            throw UsageError(fmt::format("{} is named twice; it would be counted as two runs", run.folder.string()));
    }
    Comparison comparison;
    if (runs.empty()) return comparison;
    const std::string protocol = runs[0].protocol_line();
    comparison.protocol = protocol.empty() ? "protocol: not stated by the files" : protocol;
    comparison.columns = table_columns(runs);
    for (ComparisonLine& line : grouped(runs)) {
        line.values = stats_of(samples_of(line, comparison.columns), comparison.columns);
        const RunResult& run = line.runs[0];
        auto& tables = comparison.tables;
        auto table = std::find_if(tables.begin(), tables.end(), [&](const ComparisonTable& t) {
            return t.dataset == run.dataset && t.scene == run.scene;
        });
        if (table == tables.end()) table = tables.insert(tables.end(), {run.dataset, run.scene, 1, {}});
        table->lines.push_back(std::move(line));
    }
    for (ComparisonTable& table : comparison.tables) {
        name_options(table);
        give_places(table, comparison.columns);
    }
    const std::vector<ComparisonTable> datasets = dataset_tables(comparison.tables, comparison.columns);
    comparison.tables.insert(comparison.tables.end(), datasets.begin(), datasets.end());
    return comparison;
}

}  // namespace gs
