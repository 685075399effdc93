// SPDX-License-Identifier: Apache-2.0
// The place of this process among those started to train together, from the environment of torchrun or Slurm, and the
// addresses by which two machines reach each other.
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace gs {

/// The place of this process among those started to train together.
struct RankPlace {
    int rank = 0, size = 1;
    int local_rank = 0, local_size = 1;  ///< place among the processes of this machine
    std::string master;                  ///< name or address of the machine of rank 0
    int port = 0;                        ///< port on that machine
};

/// Returns the value of an environment variable, or null.
using Environment = std::function<const char*(const char* name)>;

/// Reads RANK, WORLD_SIZE, LOCAL_RANK, LOCAL_WORLD_SIZE, MASTER_ADDR and MASTER_PORT, or else the variables of srun
/// (SLURM_PROCID, SLURM_STEP_NUM_TASKS, SLURM_LOCALID, SLURM_STEP_TASKS_PER_NODE, SLURM_STEP_NODELIST, SLURM_JOB_ID).
/// Returns nothing for a process that was started alone. Throws UsageError naming variable and value if one is invalid.
std::optional<RankPlace> rank_place(const Environment& variable);

/// Returns the first machine of a list in Slurm's format: "node[03-07,9],gpu1" -> "node03".
std::string first_of_node_list(const std::string& list);

/// The two ends of the route to another machine, as numeric addresses: "10.0.0.7".
struct Route {
    std::string own, other;
    /// Returns whether the route stays on this machine.
    bool is_local() const { return own == other || own.starts_with("127.") || own == "::1"; }
};

/// Returns the route that packets to `host` would take; nothing is sent. (A machine's own name often resolves to
/// 127.0.1.1, which no other machine can use.) Throws DeviceError for an unknown or unreachable host.
Route route_to(const std::string& host, int port);

}  // namespace gs
