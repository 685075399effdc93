// SPDX-License-Identifier: Apache-2.0
// How a subcommand joins the program: it declares its arguments, and names the work to do when it was chosen.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace gs {

/// The work of the chosen subcommand. It runs after the whole command line was read; errors leave it as exceptions.
using Command = std::function<void()>;

// Each adds one subcommand to `app` and, in its callback, sets `selected`. One file per subcommand.
void add_train_command(CLI::App& app, Command& selected);
void add_eval_command(CLI::App& app, Command& selected);
void add_render_command(CLI::App& app, Command& selected);
void add_export_command(CLI::App& app, Command& selected);
void add_view_command(CLI::App& app, Command& selected);
void add_prepare_command(CLI::App& app, Command& selected);
void add_bench_command(CLI::App& app, Command& selected);
void add_tradeoff_command(CLI::App& app, Command& selected);
void add_metrics_command(CLI::App& app, Command& selected);
void add_options_command(CLI::App& app, Command& selected);
void add_doctor_command(CLI::App& app, Command& selected);
void add_completions_command(CLI::App& app, Command& selected);
void add_manual_command(CLI::App& app, Command& selected);

}  // namespace gs
