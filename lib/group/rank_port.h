// SPDX-License-Identifier: Apache-2.0
// The state shared by the ranks (Roster): published values, the time of each rank's last report, and the first failure.
// Rank 0 keeps the roster and answers the other ranks, and no other process, at a port (RankPort).
#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "lib/group/rank_call.h"

namespace gs {

/// A port at which a rank answers the other ranks of its job, and no other process.
class RankPort {
  public:
    /// Returns the answer to a request, or nothing if it is too early; the handler is then called again.
    using Handler = std::function<std::optional<RankAnswer>(const RankRequest& request)>;

    /// Listens at `port` of `address`, or at any free port for 0, and answers in a separate thread until it is
    /// destroyed. `handler` answers all requests except those for a connection (take). Connections without proof of the
    /// job are dropped. Their data has no other effect and does not block other connections, and beyond 64 + 2 `size`
    /// of them the oldest are dropped first. Throws DeviceError if rank `rank` cannot listen there.
    RankPort(const std::string& address, int port, int rank, int size, const Credentials& credentials,
             Handler handler = {});
    ~RankPort();
    int port() const;

    /// Waits for the connection that `rank` requests, and returns it; nothing after `seconds`.
    std::optional<Descriptor> take(int rank, double seconds);

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
};

/// The seconds of silence after which a rank counts as lost. Each rank reports every second.
inline constexpr double kLongestSilence = 15;
/// The seconds after which a rank that has not reported counts as missing.
inline constexpr double kLongestWait = 120;

/// The state shared by the ranks: published values, last reports, and the first failure. Rank 0 keeps it.
class Roster {
  public:
    explicit Roster(int size);

    int size() const { return int(heard_.size()); }
    void set(const std::string& key, const std::vector<char>& value);
    /// Waits for a value and returns it; nothing after `seconds` or after a failure.
    std::optional<std::vector<char>> get(const std::string& key, double seconds);

    /// Records that `rank`, on machine `host`, is alive.
    void hear_of(int rank, const std::string& host);
    /// Records a failure; only the first one is kept.
    void fail(const std::string& message);
    /// Returns the failure, or an empty text.
    std::string failure() const;
    /// Records a failure if a rank other than 0 has been silent for too long or has never reported.
    void look_for_lost_ranks();

  private:
    struct Heard {
        double seconds = 0;  ///< time of the last report; 0 = never
        std::string host;
    };
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::map<std::string, std::vector<char>> values_;
    std::vector<Heard> heard_;  ///< last reports by rank
    double start_, last_look_;
    std::string failure_;
};

/// Returns a handler that answers requests from the roster, which must outlive the port.
RankPort::Handler answers_of(Roster& roster);

/// Access to the roster from a rank other than 0. All functions throw DeviceError if rank 0 cannot be reached, belongs
/// to another job or has another secret.
class RosterClient {
  public:
    RosterClient(int rank, const std::string& master, int port, const Credentials& credentials)
        : rank_(rank), address_{0, master, port}, credentials_(credentials) {}

    void set(const std::string& key, const std::vector<char>& value);
    /// Waits for a value and returns it. Throws DeviceError if a failure comes first.
    std::vector<char> get(const std::string& key);
    /// Reports to rank 0 that this rank, on machine `host`, is alive. Retries for `patience` seconds while rank 0
    /// cannot be reached. Returns the failure of the job, or an empty text.
    std::string report(const std::string& host, double patience);
    /// Reports a failure to rank 0. Tries only once, since this rank ends in any case.
    void fail(const std::string& message);

  private:
    RankAnswer ask_rank_0(RankRequest::Call call, const std::string& key, const std::string& value,
                          double patience) const;

    const int rank_;
    const RankAddress address_;
    const Credentials credentials_;
};

}  // namespace gs
