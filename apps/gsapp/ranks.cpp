// SPDX-License-Identifier: Apache-2.0
// Starts the ranks of a command.
#include "apps/gsapp/ranks.h"

#include "kernels/base/parallel.h"

namespace gs {

CLI::Option* add_ranks_option(CLI::App& command, int& ranks) {
    return command
        .add_option("--ranks", ranks,
                    "Processes of this machine that share the Gaussians and render views at the same time, each with "
                    "a GPU of its own if the device is a GPU (docs/ranks.md)")
        ->check(CLI::Range(1, 4096));
}

std::unique_ptr<RankTeam> join_ranks(int ranks, const std::string& command, const std::string& subject, int threads) {
    if (ranks == 1) return nullptr;
    auto team = RankTeam::join(ranks, command + " " + subject);
    set_num_threads(threads_of_rank(*team, threads));
    if (team->rank() == 0) team->agree(started_as(command));
    return team;
}

}  // namespace gs
