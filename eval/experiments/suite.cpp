// SPDX-License-Identifier: Apache-2.0
// Defines the suites, trains their jobs, and writes the results as text and JSON.
#include "eval/experiments/suite.h"

#include <fmt/format.h>

#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/scene.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct Row {
    std::string name, folder;
    std::function<void(TrainOptions&)> vary;
};

std::vector<Row> densification_rows() {
    const auto strategy = [](Strategy rule, bool speedy) {
        return [=](TrainOptions& o) { o.strategy = rule, o.speedy_splat = speedy; };
    };
    const auto tenth = [](TrainOptions& o) {
        o.strategy = Strategy::kMcmc, o.speedy_splat = false;
        limit_budget(o, 0.1);
    };
    return {{"MCMC", "mcmc", strategy(Strategy::kMcmc, false)},
            {"MCMC 0.1x", "mcmc-0.1x", tenth},
            {"ADC", "adc", strategy(Strategy::kAdc, false)},
            {"ADC + Speedy-Splat", "adc-speedy", strategy(Strategy::kAdc, true)}};
}

std::vector<Row> activation_rows() {
    struct Rate {
        const char* name;
        std::optional<double> value;
    };
    constexpr Rate kRates[] = {{"0.05", 0.05}, {"0.025", 0.025}, {"auto", std::nullopt}};
    std::vector<Row> rows;
    for (const std::string& activation : words<ColorActivation>())
        for (const Rate& rate : kRates)
            rows.push_back({fmt::format("{}, opacity rate {}", activation, rate.name),
                            fmt::format("{}-{}", activation, rate.name),
                            [kind = *choice_of<ColorActivation>(activation), value = rate.value](TrainOptions& o) {
                                o.color_activation = kind, o.opacity_lr = value;
                                o.named.insert("opacity-lr");
                            }});
    return rows;
}

struct Suite {
    const char* name;
    std::vector<Row> (*rows)();
};
constexpr Suite kSuites[] = {{"densification", densification_rows}, {"activations", activation_rows}};

std::vector<Row> rows_of(const std::string& suite) {
    for (const Suite& s : kSuites)
        if (s.name == suite) return s.rows();
    throw UsageError(fmt::format("suite: '{}' is not one of {}", suite, fmt::join(suite_names(), ", ")));
}

using Json = nlohmann::ordered_json;

Json json_of(const SuiteLine& line) {
    Json json = {{"row", line.row}, {"appearance", line.appearance}, {"run", line.job.options.model}};
    json["status"] = line.result ? "finished" : line.error.empty() ? "not trained" : "failed";
    if (!line.error.empty()) json["error"] = line.error;
    if (!line.result) return json;
    json.update(job_json(*line.result));
    return json;
}

}  // namespace

std::vector<std::string> suite_names() {
    std::vector<std::string> names;
    for (const Suite& suite : kSuites) names.push_back(suite.name);
    return names;
}

std::vector<SuiteLine> suite_lines(const std::string& suite, const std::vector<std::string>& appearances,
                                   const TrainOptions& base) {
    std::vector<SuiteLine> lines;
    for (const std::string& appearance : appearances)
        for (const Row& row : rows_of(suite)) {
            TrainOptions options = base;
            options.appearance = appearance;
            options.eval = true;
            set_folder(options, fs::path(base.model) / (row.folder + "-" + appearance));
            row.vary(options);
            require_named_appearance(options);
            options = resolve(options);
            lines.push_back({row.name, appearance, {fmt::format("{}, {}", row.name, appearance), std::move(options)}});
        }
    return lines;
}

SuiteRun run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base,
                   const JobsRunner& run) {
    if (base.model.empty())
        base.model = (std::filesystem::path("output") / (scene_name(base.source) + "-" + suite)).string();
    if (!base.resume.empty())
        throw UsageError("suite: runs are not resumed; the same command again trains those that are missing");
    SuiteRun done{base.model, suite_lines(suite, appearances, base), {}};
    if (done.lines.empty()) throw UsageError("--appearances: no appearance model named");
    std::vector<Job> jobs;
    for (const SuiteLine& line : done.lines) jobs.push_back(line.job);
    write_suite(done.folder, suite, done.lines);
    done.summary = run(jobs, {.done = [&](std::size_t k, const JobOutcome& outcome) {
                           done.lines[k].result = outcome.result, done.lines[k].error = outcome.error;
                           write_suite(done.folder, suite, done.lines);
                       }});
    return done;
}

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
        const RunResult& r = *line.result;
        table.lines.push_back({{line.row},
                               {line.appearance},
                               {fmt::format("{:.2f}", r.psnr)},
                               {fmt::format("{:.4f}", r.ssim)},
                               {fmt::format("{}", *r.num_gaussians)},
                               {fmt::format("{:.1f}", *r.train_seconds)},
                               {fmt::format("{:.1f}", r.fps().value_or(0))},
                               {fmt::format("{:.1f}", 1e-6 * double(*r.bytes))}});
    }
    std::string text = table.lines.empty() ? "No run was trained to its end.\n" : table_text(table, style);
    if (!others.empty()) text += "\nWithout a result:\n\n" + others;
    return text;
}

std::string suite_json(const std::string& suite, const std::vector<SuiteLine>& lines) {
    Json json = {{"suite", suite},
                 {"scene", lines.empty() ? "" : lines.front().job.options.source},
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
