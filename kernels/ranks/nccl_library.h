// SPDX-License-Identifier: Apache-2.0
// NCCL, which sends arrays from GPU to GPU. It is loaded where it is used, and never linked.
#pragma once

#include <string>

namespace gs {

/// What came of looking for NCCL.
struct NcclFinding {
    std::string version;  ///< "2.28.3"; empty where it cannot be used
    std::string path;     ///< of the library
    std::string why_not;  ///< empty where it can be used
};

/// Loads NCCL and asks for its version: from the file that the environment variable GSAPP_NCCL names (`off`: from
/// nowhere), or else from where the loader finds libnccl.so.2, or else from the folder of CUDA.
NcclFinding find_nccl();

/// Says how NCCL is got.
inline constexpr const char* kGetNccl =
    "apt-get install libnccl2, from NVIDIA's packages for CUDA, or GSAPP_NCCL=path of libnccl.so.2";

}  // namespace gs
