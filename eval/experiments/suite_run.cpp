// SPDX-License-Identifier: Apache-2.0
// Runs the cells of a suite and writes its tables after each.
#include "eval/experiments/suite_run.h"

#include "kernels/base/error.h"
#include "lib/train/scene_options.h"

namespace gs {

SuiteRun run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base,
                   const CellsRunner& run) {
    if (base.model.empty())
        base.model = (std::filesystem::path("output") / (scene_name(base.source) + "-" + suite)).string();
    if (!base.resume.empty())
        throw UsageError("suite: runs are not resumed; the same command again trains those that are missing");
    SuiteRun done{base.model, suite_lines(suite, appearances, base), {}};
    if (done.lines.empty()) throw UsageError("--appearances: no appearance model named");
    std::vector<Cell> cells;
    for (const SuiteLine& line : done.lines) cells.push_back(line.cell);
    write_suite(done.folder, suite, done.lines);
    done.summary = run(cells, {.done = [&](std::size_t k, const CellOutcome& outcome) {
                           done.lines[k].result = outcome.result, done.lines[k].error = outcome.error;
                           write_suite(done.folder, suite, done.lines);
                       }});
    return done;
}

}  // namespace gs
