// SPDX-License-Identifier: Apache-2.0
// The interface of a subcommand: it declares its arguments, and sets the work to do if it is chosen.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace gs {

/// The work of the chosen subcommand. It runs after the whole command line has been parsed; errors propagate as
/// exceptions.
using Command = std::function<void()>;

// Each function adds one subcommand to `app`, whose callback sets `selected`. One file per subcommand.
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
