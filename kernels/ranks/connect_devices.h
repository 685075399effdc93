// SPDX-License-Identifier: Apache-2.0
// Connects the devices of ranks by NCCL, so that their arrays need not pass through the host. NCCL is loaded where it
// is used, and never linked.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "kernels/ranks/communicator.h"

namespace gs {

/// What came of looking for NCCL.
struct NcclFinding {
    std::string version;  ///< "2.28.3"; empty if it cannot be used
    std::string path;     ///< of the library
    std::string why_not;  ///< empty if it can be used
};

/// Loads NCCL and asks for its version: from the file that the environment variable GSAPP_NCCL names (`off`: from
/// nowhere), or else from where the loader finds libnccl.so.2, or else from the folder of CUDA.
NcclFinding find_nccl();

/// Says how NCCL is got.
inline constexpr const char* kGetNccl =
    "apt-get install libnccl2, from NVIDIA's packages for CUDA, or GSAPP_NCCL=path of libnccl.so.2";

/// Lets arrays go from device to device by NCCL from now on, if all ranks can. All must call it, each on its own
/// device, which `device` tells from all others (cuda_device_id()); it is empty if a rank has none. Returns why they
/// cannot, and how that is changed; an empty text if they can, or if no rank has a device. Throws DeviceError when NCCL
/// fails or a rank is lost.
std::string connect_devices(Communicator& ranks, const std::string& device);

/// What ranks need to know of a connection by NCCL to be part of it: an ncclUniqueId.
using NcclId = std::array<char, 128>;

/// Makes the id of a new connection, on one of its ranks. Throws DeviceError.
NcclId make_nccl_id();

/// Joins the connection that the id names; all ranks must do so. Their current devices must all differ. Throws
/// DeviceError when NCCL fails, or when ranks.abort() is called.
std::unique_ptr<DeviceLink> connect_by_nccl(const Communicator& ranks, const NcclId& id);

}  // namespace gs
