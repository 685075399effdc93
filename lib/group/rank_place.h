// SPDX-License-Identifier: Apache-2.0
// The place of this process among those that were started to train together, as torchrun and Slurm tell it, and the
// addresses by which two machines reach each other.
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace gs {

/// The place of this process among those that were started to train together.
struct RankPlace {
    int rank = 0, size = 1;
    int local_rank = 0, local_size = 1;  ///< among the processes of this machine
    std::string master;                  ///< name or address of the machine of rank 0
    int port = 0;                        ///< on that machine
};

/// Returns the value of an environment variable, or null.
using Environment = std::function<const char*(const char* name)>;

/// Reads RANK, WORLD_SIZE, LOCAL_RANK, LOCAL_WORLD_SIZE, MASTER_ADDR and MASTER_PORT, or else those that srun sets
/// (SLURM_PROCID, SLURM_STEP_NUM_TASKS, SLURM_LOCALID, SLURM_STEP_TASKS_PER_NODE, SLURM_STEP_NODELIST, SLURM_JOB_ID).
/// Returns nothing for a process that was started alone. Throws UsageError naming variable and value.
std::optional<RankPlace> rank_place(const Environment& variable);

/// Returns the first machine of a list as Slurm writes it: "node[03-07,9],gpu1" -> "node03".
std::string first_of_node_list(const std::string& list);

/// The two ends of the way to another machine, as numbers: "10.0.0.7".
struct Route {
    std::string own, other;
    /// Returns whether the way does not leave this machine.
    bool is_local() const { return own == other || own.starts_with("127.") || own == "::1"; }
};

/// Returns the way by which packets to `host` would go; nothing is sent. (A machine's own name often leads to
/// 127.0.1.1 if no other machine finds it.) Throws DeviceError for a name that is not known, or cannot be reached.
Route route_to(const std::string& host, int port);

}  // namespace gs
