// SPDX-License-Identifier: Apache-2.0
// Finds NCCL by dlopen and dlsym, and uses it to send arrays from device to device on a stream of its own.
#include <dlfcn.h>
#include <nccl.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/ranks/connect_devices.h"

namespace gs {
namespace {

constexpr const char* kName = "libnccl.so.2";

/// A loaded library. It is never unloaded, because NCCL has threads of its own.
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

/// Throws DeviceError for an error, with `what` and NCCL's own message. A call still in progress is no error.
void nccl_check(const NcclLibrary& nccl, ncclResult_t result, const char* what) {
    if (result == ncclSuccess || result == ncclInProgress) return;
    const char* const details = nccl.get_last_error(nullptr);
    throw DeviceError(std::string(what) + ": " + nccl.get_error_string(result) +
                      (details && *details ? " (" + std::string(details) + ")" : ""));
}

/// Returns the value of an environment variable, empty if it is not set.
std::string variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

/// Returns the file names to try for the library, in order.
std::vector<std::string> places() {
    const std::string chosen = variable("GSAPP_NCCL");
    if (chosen == "off") throw DeviceError("GSAPP_NCCL=off");
    if (!chosen.empty()) return {chosen};  // an explicit choice has no fallback
    std::vector<std::string> names = {kName};
    for (const std::string& cuda : {variable("CUDA_HOME"), variable("CUDA_PATH"), std::string("/usr/local/cuda")})
        for (const char* folder : {"lib64", "lib"})
            if (const std::string file = cuda + "/" + folder + "/" + kName;
                !cuda.empty() && std::filesystem::exists(file))
                names.push_back(file);
    return names;
}

/// Returns the file that contains a function of a library.
std::string file_of(void* function) {
    Dl_info info{};
    return ::dladdr(function, &info) != 0 && info.dli_fname ? info.dli_fname : "";
}

/// Converts NCCL's version number to text: 22803 -> "2.28.3".
std::string text_of_version(int number) {
    return std::to_string(number / 10000) + "." + std::to_string(number % 10000 / 100) + "." +
           std::to_string(number % 100);
}

/// Finds all functions. Throws DeviceError with the name of a missing one.
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

/// Loads NCCL from the places of find_nccl(). Throws DeviceError with the error of each place.
NcclLibrary load_nccl() {
    std::string errors;
    for (const std::string& name : places()) {
        void* const handle = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
        if (handle) return functions_of(handle, name);
        errors += (errors.empty() ? "" : "; ") + std::string(::dlerror());
    }
    throw DeviceError("NCCL was not found (" + errors + ")");
}

// Sends arrays from device to device by NCCL, on a stream of its own. No call waits for other ranks inside NCCL, so
// that an abort() from another thread is noticed while a lost rank blocks this one. If the device waits for the lost
// rank, that thread also ends the wait.

/// Seconds of busy waiting before pauses: longer than an exchange between equally fast ranks.
constexpr double kWithoutPause = 0.01;
constexpr std::chrono::microseconds kPause(100);
/// Seconds that NCCL gets for disconnecting from other ranks.
constexpr double kLongestLeave = 5;

static_assert(sizeof(NcclId) == sizeof(ncclUniqueId));

class NcclLink final : public DeviceLink {
  public:
    NcclLink(NcclLibrary nccl, int rank, int size, std::stop_token stop)
        : nccl_(std::move(nccl)), rank_(rank), size_(size), stop_(std::move(stop)) {
        end_.emplace(stop_, [this] { break_off(); });
    }

    void connect(const NcclId& id) {
        ncclUniqueId unique;
        std::memcpy(&unique, &id, sizeof unique);
        ncclConfig_t config = NCCL_CONFIG_INITIALIZER;
        config.blocking = 0;
        or_break_off([&] {
            constexpr const char* kCall = "ncclCommInitRankConfig";
            {
                const std::lock_guard lock(mutex_);
                nccl_check(nccl_, nccl_.comm_init_rank_config(&comm_, size_, unique, rank_, &config), kCall);
            }
            wait_until([&] { return is_ready(kCall); });
        });
    }

    ~NcclLink() override {
        end_.reset();
        if (!comm_) return;
        try {
            nccl_check(nccl_, nccl_.comm_finalize(comm_), "ncclCommFinalize");
            const double start = seconds_now();
            wait_until([&] {
                if (seconds_now() - start > kLongestLeave) throw DeviceError("NCCL does not take its leave");
                return is_ready("ncclCommFinalize");
            });
            nccl_.comm_destroy(comm_);
        } catch (const DeviceError&) {
            break_off();  // the work is done, or lost and already reported
        }
    }

    std::string name() const override { return "NCCL " + nccl_.version; }

    void begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream& device) override {
        finish();
        const auto stream = static_cast<cudaStream_t>(device.begin_transfer());
        or_break_off([&] {
            const std::lock_guard lock(mutex_);
            if (!comm_) throw DeviceError(kEnded);
            ncclResult_t result = nccl_.group_start();
            const char* what = "ncclGroupStart";
            const auto call = [&](const char* name, auto&& function) {
                if (result != ncclSuccess && result != ncclInProgress) return;
                what = name;
                result = function();
            };
            for (std::size_t k = 0; k < out.size(); ++k) {
                const int r = int(k) % size_;
                if (r == rank_) continue;
                const ConstBytes from = out[k];
                const Bytes to = in[k];
                if (!from.empty())
                    call("ncclSend", [&] { return nccl_.send(from.data(), from.size(), ncclInt8, r, comm_, stream); });
                if (!to.empty())
                    call("ncclRecv", [&] { return nccl_.recv(to.data(), to.size(), ncclInt8, r, comm_, stream); });
            }
            const ncclResult_t end = nccl_.group_end();  // ends the group after an error, too
            call("ncclGroupEnd", [&] { return end; });
            nccl_check(nccl_, result, what);
        });
    }

    /// A transfer is on the stream only once NCCL is ready: a thread of NCCL puts it there.
    void finish() override {
        or_break_off([&] { wait_until([&] { return is_ready("NCCL"); }); });
    }

  private:
    static constexpr const char* kEnded = "the connection to the other GPUs was ended";

    /// Returns whether NCCL has completed the last call. Throws DeviceError if the call or the connection has failed.
    bool is_ready(const char* what) {
        const std::lock_guard lock(mutex_);
        if (!comm_) throw DeviceError(kEnded);
        ncclResult_t state = ncclSuccess;
        nccl_check(nccl_, nccl_.comm_get_async_error(comm_, &state), "ncclCommGetAsyncError");
        nccl_check(nccl_, state, what);
        return state == ncclSuccess;
    }

    template <class Done> void wait_until(Done&& done) {
        for (const double start = seconds_now(); !done();) {
            if (stop_.stop_requested()) throw DeviceError(kEnded);
            if (seconds_now() - start < kWithoutPause)
                std::this_thread::yield();
            else
                std::this_thread::sleep_for(kPause);
        }
    }

    /// Calls work(). After an error, breaks off the connection.
    template <class Work> void or_break_off(Work&& work) {
        try {
            work();
        } catch (const DeviceError&) {
            break_off();
            throw;
        }
    }

    /// Ends all transfers, also on the device, without the other ranks.
    void break_off() {
        const std::lock_guard lock(mutex_);
        if (comm_) nccl_.comm_abort(comm_);
        comm_ = nullptr;
    }

    const NcclLibrary nccl_;
    const int rank_, size_;
    const std::stop_token stop_;
    std::mutex mutex_;           ///< guards comm_, which another thread may abort
    ncclComm_t comm_ = nullptr;  ///< null once ended
    std::optional<std::stop_callback<std::function<void()>>> end_;
};

}  // namespace

NcclFinding find_nccl() {
    try {
        const NcclLibrary nccl = load_nccl();
        return {nccl.version, nccl.path, ""};
    } catch (const DeviceError& e) {
        return {"", "", e.what()};
    }
}

NcclId make_nccl_id() {
    const NcclLibrary nccl = load_nccl();
    ncclUniqueId unique;
    nccl_check(nccl, nccl.get_unique_id(&unique), "ncclGetUniqueId");
    NcclId id;
    std::memcpy(&id, &unique, sizeof id);
    return id;
}

std::unique_ptr<DeviceLink> connect_by_nccl(const Communicator& ranks, const NcclId& id) {
    auto link = std::make_unique<NcclLink>(load_nccl(), ranks.rank(), ranks.size(), ranks.stop_token());
    link->connect(id);
    return link;
}

}  // namespace gs
