// SPDX-License-Identifier: Apache-2.0
// Connects ranks through sockets.
#pragma once

#include <memory>
#include <vector>

#include "kernels/base/descriptor.h"
#include "kernels/ranks/communicator.h"

namespace gs {

/// Makes this rank's end of the connection of all ranks: `to_rank` holds a stream socket to each of them, which nobody
/// else uses, and none to itself. An exchange takes as long as the other ranks need; it fails at once if one of them
/// ends, and whoever finds that one hangs calls abort(). Every array is preceded by its size in 8 bytes. Throws
/// DeviceError when the system lacks what is needed.
std::unique_ptr<Communicator> connect_by_sockets(int rank, std::vector<Descriptor> to_rank);

}  // namespace gs
