// SPDX-License-Identifier: Apache-2.0
// Finds NCCL by dlopen and dlsym.
#include "kernels/ranks/nccl_library.h"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>
#include <vector>

#include "kernels/base/error.h"
#include "kernels/ranks/nccl_library_cuda.h"

namespace gs {
namespace {

constexpr const char* kName = "libnccl.so.2";

/// Returns the value of an environment variable, empty where it is not set.
std::string variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

/// Returns the names under which the library is tried, in order.
std::vector<std::string> places() {
    const std::string chosen = variable("GSAPP_NCCL");
    if (chosen == "off") throw DeviceError("GSAPP_NCCL=off");
    if (!chosen.empty()) return {chosen};  // what was asked for is not replaced by something else
    std::vector<std::string> names = {kName};
    for (const std::string& cuda : {variable("CUDA_HOME"), variable("CUDA_PATH"), std::string("/usr/local/cuda")})
        for (const char* folder : {"lib64", "lib"})
            if (const std::string file = cuda + "/" + folder + "/" + kName;
                !cuda.empty() && std::filesystem::exists(file))
                names.push_back(file);
    return names;
}

/// Returns the file in which a function of a library is.
std::string file_of(void* function) {
    Dl_info info{};
    return ::dladdr(function, &info) != 0 && info.dli_fname ? info.dli_fname : "";
}

/// Turns NCCL's number of a version into text: 22803 -> "2.28.3".
std::string text_of_version(int number) {
    return std::to_string(number / 10000) + "." + std::to_string(number % 10000 / 100) + "." +
           std::to_string(number % 100);
}

/// Finds all functions. Throws DeviceError naming one that is missing.
NcclLibrary functions_of(void* handle, const std::string& name) {
    const auto find = [&](auto& function, const char* symbol) {
        void* const address = ::dlsym(handle, symbol);
        if (!address) throw DeviceError(name + " has no " + symbol + ": it is not NCCL, or older than 2.14");
        function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(address);
    };
    NcclLibrary nccl{};
    find(nccl.get_version, "ncclGetVersion");
    find(nccl.get_error_string, "ncclGetErrorString");
    find(nccl.get_last_error, "ncclGetLastError");
    find(nccl.get_unique_id, "ncclGetUniqueId");
    find(nccl.comm_init_rank_config, "ncclCommInitRankConfig");
    find(nccl.comm_get_async_error, "ncclCommGetAsyncError");
    find(nccl.comm_finalize, "ncclCommFinalize");
    find(nccl.comm_destroy, "ncclCommDestroy");
    find(nccl.comm_abort, "ncclCommAbort");
    find(nccl.group_start, "ncclGroupStart");
    find(nccl.group_end, "ncclGroupEnd");
    find(nccl.send, "ncclSend");
    find(nccl.recv, "ncclRecv");
    nccl.path = file_of(reinterpret_cast<void*>(nccl.get_version));
    int version = 0;
    nccl_check(nccl, nccl.get_version(&version), "ncclGetVersion");
    nccl.version = text_of_version(version);
    return nccl;
}

}  // namespace

NcclLibrary load_nccl() {
    std::string errors;
    for (const std::string& name : places()) {
        void* const handle = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
        if (handle) return functions_of(handle, name);
        errors += (errors.empty() ? "" : "; ") + std::string(::dlerror());
    }
    throw DeviceError("NCCL was not found (" + errors + ")");
}

void nccl_check(const NcclLibrary& nccl, ncclResult_t result, const char* what) {
    if (result == ncclSuccess || result == ncclInProgress) return;
    const char* const details = nccl.get_last_error(nullptr);
    throw DeviceError(std::string(what) + ": " + nccl.get_error_string(result) +
                      (details && *details ? " (" + std::string(details) + ")" : ""));
}

NcclFinding find_nccl() {
    try {
        const NcclLibrary nccl = load_nccl();
        return {nccl.version, nccl.path, ""};
    } catch (const DeviceError& e) {
        return {"", "", e.what()};
    }
}

}  // namespace gs
