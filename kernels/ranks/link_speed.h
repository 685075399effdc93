// SPDX-License-Identifier: Apache-2.0
// How fast the connection between the ranks is.
#pragma once

#include "kernels/ranks/communicator.h"

namespace gs {

/// The connection of one rank with the others, while all exchange at the same time as they do in a step. 0 for a rank
/// alone.
struct LinkSpeed {
    double message_bytes = 0;     ///< that each rank sent in one exchange, and received
    double bytes_per_second = 0;  ///< of the way that splats take: sent by a rank while it received as many, median
    double latency_seconds = 0;   ///< of an exchange of 16 bytes with each other rank, host to host: median
    double device_latency_seconds = 0;  ///< of one of 16 bytes from device to device, until it is there; 0 without any
};

/// Measures the connection, from the memory of `device` to that of the other ranks', or between hosts where it is null.
/// All ranks must call it.
LinkSpeed measure_link(Communicator& ranks, DeviceStream* device);

}  // namespace gs
