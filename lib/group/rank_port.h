// SPDX-License-Identifier: Apache-2.0
// A port at which a rank answers the other ranks of its job, and nobody else.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "lib/group/rank_call.h"

namespace gs {

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

}  // namespace gs
