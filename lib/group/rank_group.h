// SPDX-License-Identifier: Apache-2.0
// The ranks of a training: finds or starts them, connects them, and ends all of them if one is lost.
#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/ranks/communicator.h"
#include "lib/group/rank_place.h"

namespace gs {

/// The other ranks on one machine, as processes of this program with the same command line.
class LocalRanks {
  public:
    /// Starts ranks 1 to size-1, which connect to rank 0 at `port` of this machine with `secret`. They get no input,
    /// print nothing on stdout, and end with this process. Throws Error if one cannot be started.
    LocalRanks(int size, int port, const std::string& secret);
    /// Waits up to 5 seconds for the processes to end, then kills the remaining ones.
    ~LocalRanks();
    LocalRanks(const LocalRanks&) = delete;
    LocalRanks& operator=(const LocalRanks&) = delete;

    /// Returns a description of how a rank ended, once for each rank; nothing if no other rank has ended.
    std::optional<std::string> first_lost();
    /// Kills the processes at once.
    void kill();

  private:
    struct Process {
        int rank;
        pid_t pid;
        bool running = true;
    };
    std::vector<Process> processes_;
};

/// Makes this process end with its parent if it was started by LocalRanks. Does nothing otherwise.
void end_with_rank_0();

/// The ranks of a training.
class RankGroup {
  public:
    /// Joins the ranks that torchrun or Slurm started (rank_place), or else starts `local_ranks` - 1 processes beside
    /// this one, which becomes rank 0. They get the same command line. `work` identifies their task, such as the run
    /// folder, so that ranks with another task at the same port do not interfere. Ranks without the group's secret
    /// (shared_secret; a new one for processes started here) are refused. Returns null for a single process. Throws
    /// UsageError if both ways are requested with different numbers of ranks or if there is no secret, DeviceError if
    /// rank 0 cannot be reached.
    static std::unique_ptr<RankGroup> join(int local_ranks, const std::string& work);
    /// Ends the group: rank 0 sends the other ranks the message to leave.
    ~RankGroup();

    int rank() const;
    int size() const;
    /// Return the number of ranks on this machine, and this rank's index among them.
    int local_size() const;
    int local_rank() const;

    /// set() publishes a value to all ranks, and get() waits for one. Throw DeviceError if a rank is lost first.
    void set(const std::string& key, const std::string& value);
    std::string get(const std::string& key);

    /// Returns the communicator of the group. The first call connects all ranks, and all must make it. After a failure
    /// the communicator's functions throw DeviceError with its cause within kLongestSilence.
    Communicator& communicator();

    /// Connects the devices of the ranks so that they exchange arrays without the host, if possible
    /// (gs::connect_devices). All ranks must call it. Returns the reason if it is not possible, else an empty text.
    /// Later calls do nothing.
    std::string connect_devices(const std::string& device);

    /// Checks that all ranks were started with the same settings. Rank 0 publishes `text`, one setting per line; the
    /// others throw UsageError naming the first line that differs.
    void agree(const std::string& text);
    /// On a rank other than 0: calls part(). If part() throws, sends the error to rank 0, which prints it, and throws
    /// DeviceError without a message. If rank 0 cannot be reached, rethrows the error.
    void follow(const std::function<void()>& part);

  private:
    bool fail(const std::string& message);

    struct Implementation;
    explicit RankGroup(std::unique_ptr<Implementation> implementation);
    std::unique_ptr<Implementation> implementation_;
};

/// The commands of rank 0 to the other ranks: hold rows of a model, or leave.
enum class GroupCall : std::uint8_t { kHold, kLeave };

}  // namespace gs
