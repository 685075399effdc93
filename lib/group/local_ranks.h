// SPDX-License-Identifier: Apache-2.0
// The other ranks of one machine, as processes of this program with the same command line.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace gs {

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

}  // namespace gs
