// SPDX-License-Identifier: Apache-2.0
// What the subcommands of `gsapp bench` share.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "apps/gsapp/command.h"
#include "eval/bench/bench.h"
#include "lib/core/options_cli.h"

namespace gs {

// Each adds one subcommand to `bench` and, in its callback, sets `selected`.
void add_bench_frames_command(CLI::App& bench, Command& selected);
void add_bench_suite_command(CLI::App& bench, Command& selected);
void add_bench_precision_command(CLI::App& bench, Command& selected);
void add_bench_stability_command(CLI::App& bench, Command& selected);

/// The values of --repeat and --frame-repeat.
struct BenchRepeats {
    int repeat = 0, frame_repeat = 0;  ///< 0 = by device
};
void add_repeat_option(CLI::App& command, BenchRepeats& repeats);
void add_frame_repeat_option(CLI::App& command, BenchRepeats& repeats);

/// Adds --generate. Returns the option.
CLI::Option* add_generate_option(CLI::App& command, std::vector<std::int64_t>& sizes);

/// Adds --iteration; -1 = the last saved one. Returns the option.
CLI::Option* add_iteration_option(CLI::App& command, std::int64_t& iteration);
inline std::optional<std::int64_t> saved_iteration(std::int64_t iteration) {
    return iteration < 0 ? std::nullopt : std::optional(iteration);
}

/// Adds the .ply file that may stand without a flag, as -m FILE.ply. To be called before the scene is declared, which
/// may stand without a flag, too.
void add_point_cloud_option(CLI::App& command, std::string& file);

/// Returns the options of a measurement of a trained model: those of the run in -m, or for a point cloud (`file`, or
/// -m FILE.ply) the flags'. Throws UsageError, also for a point cloud without a scene.
TrainOptions measured_options(const TrainArguments& train, const std::string& file);

/// Sets up messages and threads as the options say.
void prepare_bench(const TrainOptions& options);

}  // namespace gs
