// SPDX-License-Identifier: Apache-2.0
// Runs the cells of a suite, writes its tables after each, and prints them.
#include "apps/gsapp/suite.h"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>

#include "eval/experiments/cell_runner.h"
#include "eval/experiments/suite.h"
#include "lib/core/interrupt.h"
#include "lib/train/scene_options.h"

namespace gs {

namespace fs = std::filesystem;

void run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base) {
    if (base.model.empty()) base.model = (fs::path("output") / (scene_name(base.source) + "-" + suite)).string();
    if (!base.resume.empty()) throw UsageError("--suite: runs are not resumed; the same command again trains those that are missing");
    std::vector<SuiteLine> lines;
    std::vector<Cell> cells;
    for (const SuiteCell& cell : suite_cells(suite, appearances, base)) {
        lines.push_back({cell, std::nullopt, ""});
        cells.push_back({fmt::format("{}, {}", cell.row, cell.appearance), cell.options});
    }
    if (cells.empty()) throw UsageError("--appearances: no appearance model named");
    const fs::path folder = base.model;
    write_suite(folder, suite, lines);
    catch_interrupts();
    const CellsSummary summary = run_cells(cells, {.done = [&](std::size_t k, const CellOutcome& outcome) {
        lines[k].result = outcome.result, lines[k].error = outcome.error;
        write_suite(folder, suite, lines);
    }});
    std::fputs(format_suite(lines).c_str(), stdout);
    throw_unless_complete(summary, cells.size(), folder / "suite.md");
}

}  // namespace gs
