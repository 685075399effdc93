// SPDX-License-Identifier: Apache-2.0
// What commands share that spread a model over several ranks without training it.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>

#include "lib/train/sharded_backend.h"

namespace gs {

/// Adds --ranks. Returns the option.
CLI::Option* add_ranks_option(CLI::App& command, int& ranks);

/// Joins `ranks` processes of this command and gives each its part of the CPU threads, `threads` of them or for 0 of
/// all. `subject` is what the command is called for (RankTeam::join). Rank 0 then goes on; the others have to call
/// follow_sharding(team, started_as(command)). Returns null for one rank. Throws what RankTeam::join throws.
std::unique_ptr<RankTeam> join_ranks(int ranks, const std::string& command, const std::string& subject,
                                     int threads = 0);

}  // namespace gs
