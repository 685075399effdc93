// SPDX-License-Identifier: Apache-2.0
// The ranks of a training: finds or starts them, connects them, and ends them all when one is lost.
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

/// The other ranks of one machine, as processes of this program with the same command line.
class LocalRanks {
  public:
    /// Starts ranks 1 to size-1, which meet rank 0 at `port` of this machine and know it by `secret`. They get no
    /// input, print nothing on stdout, and end when this process does. Throws Error when one cannot be started.
    LocalRanks(int size, int port, const std::string& secret);
    /// Waits for them for some seconds, and then ends them.
    ~LocalRanks();
    LocalRanks(const LocalRanks&) = delete;
    LocalRanks& operator=(const LocalRanks&) = delete;

    /// Returns in words how a rank ended that was not ended by an error that it reports itself; nothing while all run.
    std::optional<std::string> first_lost();
    /// Ends them now.
    void kill();

  private:
    struct Process {
        int rank;
        pid_t pid;
        bool running = true;
    };
    std::vector<Process> processes_;
};

/// Makes this process end with the one that started it as a LocalRank. Does nothing in others.
void end_with_rank_0();

/// The ranks of a training.
class RankGroup {
  public:
    /// Joins the ranks that torchrun or Slurm started (rank_place), or else starts `local_ranks` - 1 processes beside
    /// this one, which becomes rank 0. They get the same command line. `work` says what they are started for, such as
    /// the run folder: ranks that were started for something else, and meet at the same port, do not disturb these.
    /// Ranks without the secret of these (shared_secret; a new one for processes started here) are refused. Returns
    /// null for a process that works alone. Throws UsageError if both are asked for and differ or if there is no
    /// secret, DeviceError when rank 0 cannot be reached.
    static std::unique_ptr<RankGroup> join(int local_ranks, const std::string& work);
    /// Rank 0 tells the others that there is nothing more to do.
    ~RankGroup();

    int rank() const;
    int size() const;
    /// Returns the number of ranks on this machine, and which of them this is.
    int local_size() const;
    int local_rank() const;

    /// Shows all ranks a value, and waits for one. Throws DeviceError when a rank is lost first.
    void set(const std::string& key, const std::string& value);
    std::string get(const std::string& key);

    /// Connects all ranks, the first time that it is called; all must call it. Its calls throw DeviceError with what
    /// went wrong, if it did, within kLongestSilence.
    Communicator& communicator();

    /// Lets the devices of the ranks exchange arrays without the host, if they can (gs::connect_devices); all ranks
    /// must call it. Returns why they cannot. Does nothing when it is called again.
    std::string connect_devices(const std::string& device);

    /// Checks that all ranks were started alike. Rank 0 publishes `text`, one setting per line; the others throw
    /// UsageError naming the first line that differs.
    void agree(const std::string& text);
    /// On another rank than 0: calls part(), and tells rank 0 what goes wrong there, which prints it. Throws
    /// DeviceError without a message then; what part() threw if rank 0 cannot be told.
    void follow(const std::function<void()>& part);

  private:
    bool fail(const std::string& message);

    struct Implementation;
    explicit RankGroup(std::unique_ptr<Implementation> implementation);
    std::unique_ptr<Implementation> implementation_;
};

/// The messages with which rank 0 begins and ends what the others do: hold rows of a model, or leave.
enum class GroupCall : std::uint8_t { kHold, kLeave };

}  // namespace gs
