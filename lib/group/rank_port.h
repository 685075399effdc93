// SPDX-License-Identifier: Apache-2.0
// What the ranks know of each other (Roster): values that all see, who was heard of when, and what went wrong first.
// Rank 0 keeps it and answers the others, and nobody else, at a port (RankPort).
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

/// A port at which a rank answers the other ranks of its job, and nobody else.
class RankPort {
  public:
    /// Answers a request, or returns nothing if it is too early. Is then called again.
    using Handler = std::function<std::optional<RankAnswer>(const RankRequest& request)>;

    /// Listens at `port` of `address`, or at any free one for 0, and answers in a thread of its own until it is
    /// destroyed. `handler` answers all requests but those for a connection (take). Who does not prove to be of the job
    /// is dropped: what it sends has no other effect, it keeps nobody waiting, and of many the oldest go first, so that
    /// there are never more than some dozens. Throws DeviceError if rank `rank` cannot listen there.
    RankPort(const std::string& address, int port, int rank, int size, const Credentials& credentials,
             Handler handler = {});
    ~RankPort();
    int port() const;

    /// Returns the connection that a rank asked for, once it is there; nothing after `seconds`.
    std::optional<Descriptor> take(int rank, double seconds);

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
};

/// A rank that is silent for so long is lost. Each reports every second.
inline constexpr double kLongestSilence = 15;
/// A rank that has not come after so long is not coming.
inline constexpr double kLongestWait = 120;

/// What the ranks know of each other. Rank 0 keeps it.
class Roster {
  public:
    explicit Roster(int size);

    int size() const { return int(heard_.size()); }
    void set(const std::string& key, const std::vector<char>& value);
    /// Returns the value, once it is there; nothing after `seconds`, or when something has failed.
    std::optional<std::vector<char>> get(const std::string& key, double seconds);

    /// Notes that a rank on machine `host` is alive.
    void hear_of(int rank, const std::string& host);
    /// Notes what went wrong; only the first time counts.
    void fail(const std::string& message);
    /// Returns what went wrong, or an empty text.
    std::string failure() const;
    /// Notes a failure if a rank other than 0 has been silent for too long or has not come.
    void look_for_lost_ranks();

  private:
    struct Heard {
        double seconds = 0;  ///< when; 0 = never
        std::string host;
    };
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::map<std::string, std::vector<char>> values_;
    std::vector<Heard> heard_;  ///< by rank
    double start_, last_look_;
    std::string failure_;
};

/// Answers requests from the roster, which must outlive the port.
RankPort::Handler answers_of(Roster& roster);

/// The roster as another rank sees it. All functions throw DeviceError when rank 0 cannot be reached, is of another job
/// or has another secret.
class RosterClient {
  public:
    RosterClient(int rank, const std::string& master, int port, const Credentials& credentials)
        : rank_(rank), address_{0, master, port}, credentials_(credentials) {}

    void set(const std::string& key, const std::vector<char>& value);
    /// Waits for the value. Throws DeviceError when something fails first.
    std::vector<char> get(const std::string& key);
    /// Tells rank 0 that this rank is alive, and tries for `patience` seconds to reach it. Returns what went wrong, or
    /// an empty text.
    std::string report(const std::string& host, double patience);
    /// Tries only once, since this rank ends in any case.
    void fail(const std::string& message);

  private:
    RankAnswer ask_rank_0(RankRequest::Call call, const std::string& key, const std::string& value,
                          double patience) const;

    const int rank_;
    const RankAddress address_;
    const Credentials credentials_;
};

}  // namespace gs
