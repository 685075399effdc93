// SPDX-License-Identifier: Apache-2.0
// Connects ranks through sockets.
#pragma once

#include <memory>
#include <vector>

#include "kernels/base/descriptor.h"
#include "kernels/ranks/communicator.h"

namespace gs {

/// Makes this rank's end of the connection of all ranks: `to_rank` holds a stream socket to each other rank, for
/// exclusive use, and none to itself. An exchange takes as long as the slowest rank needs. It fails at once if another
/// rank ends; a thread that finds a rank hanging calls abort(). Every array is preceded by its size in 8 bytes. Throws
/// DeviceError if a system resource is missing.
std::unique_ptr<Communicator> connect_by_sockets(int rank, std::vector<Descriptor> to_rank);

}  // namespace gs
