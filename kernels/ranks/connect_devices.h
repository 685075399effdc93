// SPDX-License-Identifier: Apache-2.0
// Connects the devices of ranks by NCCL, so that their arrays need not pass through the host. NCCL is loaded at run
// time, and never linked.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "kernels/ranks/communicator.h"

namespace gs {

/// Result of the search for NCCL.
struct NcclFinding {
    std::string version;  ///< version, e.g. "2.28.3"; empty if NCCL cannot be used
    std::string path;     ///< path of the library
    std::string why_not;  ///< reason why NCCL cannot be used; empty if it can
};

/// Loads NCCL and returns its version. Tries the file named by the environment variable GSAPP_NCCL (`off`: none), or
/// else the loader's libnccl.so.2, or else the folder of CUDA.
NcclFinding find_nccl();

/// Instructions for installing NCCL.
inline constexpr const char* kGetNccl =
    "apt-get install libnccl2, from NVIDIA's packages for CUDA, or GSAPP_NCCL=path of libnccl.so.2";

/// Makes arrays go from device to device by NCCL from now on, if all ranks support it. All ranks must call it, each
/// with its own device. `device` identifies the device uniquely (cuda_device_id()); it is empty if a rank has none.
/// Returns the obstacle and its remedy; an empty text if there is none, or if no rank has a device. Throws DeviceError
/// if NCCL fails or a rank is lost.
std::string connect_devices(Communicator& ranks, const std::string& device);

/// Id that ranks need to join a connection by NCCL: an ncclUniqueId.
using NcclId = std::array<char, 128>;

/// Creates the id of a new connection, on one of its ranks. Throws DeviceError.
NcclId make_nccl_id();

/// Joins the connection with this id; all ranks must do so. Their current devices must all differ. Throws DeviceError
/// if NCCL fails, or if ranks.abort() is called.
std::unique_ptr<DeviceLink> connect_by_nccl(const Communicator& ranks, const NcclId& id);

}  // namespace gs
