// SPDX-License-Identifier: Apache-2.0
// Sends arrays from device to device by NCCL, on a stream of their own. No call waits for other ranks inside NCCL, so
// that the end of a training, which another thread asks for, is seen while a rank that is gone keeps this one waiting;
// where the device waits for that rank, the other thread ends that, too.
#include <chrono>
#include <cstring>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/ranks/connect_devices.h"
#include "kernels/ranks/nccl_library.h"
#include "kernels/ranks/nccl_library_cuda.h"

namespace gs {
namespace {

/// The seconds in which a wait looks without a pause: longer than an exchange between ranks that are equally fast.
constexpr double kWithoutPause = 0.01;
constexpr std::chrono::microseconds kPause(100);
/// The seconds that NCCL has to take its leave of other ranks.
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
            break_off();  // the work is done, or lost; who waits for it has said so
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

    /// A transfer is on the stream when NCCL is ready, and not before: a thread of NCCL's brings it there.
    void finish() override {
        or_break_off([&] { wait_until([&] { return is_ready("NCCL"); }); });
    }

  private:
    static constexpr const char* kEnded = "the connection to the other GPUs was ended";

    /// Returns whether NCCL has done what the last call asked for. Throws DeviceError where it failed, or where the
    /// connection has.
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

    /// Calls work(). After an error nothing more is sent.
    template <class Work> void or_break_off(Work&& work) {
        try {
            work();
        } catch (const DeviceError&) {
            break_off();
            throw;
        }
    }

    /// Ends what is on its way, on the device as well, without the other ranks.
    void break_off() {
        const std::lock_guard lock(mutex_);
        if (comm_) nccl_.comm_abort(comm_);
        comm_ = nullptr;
    }

    const NcclLibrary nccl_;
    const int rank_, size_;
    const std::stop_token stop_;
    std::mutex mutex_;           ///< of comm_, which another thread may abort
    ncclComm_t comm_ = nullptr;  ///< null when it has ended
    std::optional<std::stop_callback<std::function<void()>>> end_;
};

}  // namespace

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
