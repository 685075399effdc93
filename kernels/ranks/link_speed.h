// SPDX-License-Identifier: Apache-2.0
// How fast the connection between the ranks is.
#pragma once

#include "kernels/ranks/communicator.h"

namespace gs {

/// The connection of one rank with the others, while all exchange at the same time as they do in a step. 0 for a rank
/// alone.
struct LinkSpeed {
    double message_bytes = 0;     ///< that each rank sent in one exchange, and received
    double bytes_per_second = 0;  ///< sent by a rank while it received as many: median of a few exchanges
    double latency_seconds = 0;   ///< of an exchange of one byte with each other rank: median
};

/// Measures the connection. All ranks must call it.
LinkSpeed measure_link(Communicator& ranks);

}  // namespace gs
