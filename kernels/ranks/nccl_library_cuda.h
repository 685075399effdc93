// SPDX-License-Identifier: Apache-2.0
// The functions of NCCL. Only .cu files include this header.
#pragma once

#include <nccl.h>

#include <string>

namespace gs {

/// A library that was loaded, for as long as the process lives: NCCL has threads of its own.
struct NcclLibrary {
    std::string path, version;
    decltype(&ncclGetVersion) get_version;
    decltype(&ncclGetErrorString) get_error_string;
    decltype(&ncclGetLastError) get_last_error;
    decltype(&ncclGetUniqueId) get_unique_id;
    decltype(&ncclCommInitRankConfig) comm_init_rank_config;
    decltype(&ncclCommGetAsyncError) comm_get_async_error;
    decltype(&ncclCommFinalize) comm_finalize;
    decltype(&ncclCommDestroy) comm_destroy;
    decltype(&ncclCommAbort) comm_abort;
    decltype(&ncclGroupStart) group_start;
    decltype(&ncclGroupEnd) group_end;
    decltype(&ncclSend) send;
    decltype(&ncclRecv) recv;
};

/// Loads NCCL from where find_nccl() says. Throws DeviceError with what went wrong at each place.
NcclLibrary load_nccl();

/// Throws DeviceError, with `what` and NCCL's own words, for an error. A call that is still at work is none.
void nccl_check(const NcclLibrary& nccl, ncclResult_t result, const char* what);

}  // namespace gs
