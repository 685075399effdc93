// SPDX-License-Identifier: Apache-2.0
// Sends arrays from device to device by NCCL. No call waits for other ranks inside NCCL or CUDA, so that the end of a
// training, which another thread asks for, is seen while a rank that is gone keeps this one waiting.
#include <chrono>
#include <cstdint>
#include <cstring>
#include <thread>

#include "kernels/core/clock.h"
#include "kernels/core/error.h"
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

/// NCCL moves 16 bytes at a time between addresses that are multiples of it, and single bytes otherwise.
constexpr std::size_t kAligned = 16;

/// Arrays at addresses that NCCL likes, one for each rank, in the place of those that begin elsewhere, as the sums of a
/// rank's splats do within those of all.
class AlignedArrays {
  public:
    explicit AlignedArrays(int size) : blocks_(std::size_t(size)) {}
    /// Returns where to have the bytes instead of at `address`, which may be the same.
    std::byte* place(std::size_t rank, std::byte* address, std::size_t bytes, RankDevice& device) {
        if (bytes == 0 || reinterpret_cast<std::uintptr_t>(address) % kAligned == 0) return address;
        if (!blocks_[rank]) blocks_[rank] = device.make_block();
        return blocks_[rank]->reserve(bytes);
    }

  private:
    std::vector<std::unique_ptr<DeviceBlock>> blocks_;
};

class NcclLink final : public DeviceLink {
  public:
    NcclLink(NcclLibrary nccl, int rank, int size, std::stop_token stop)
        : nccl_(std::move(nccl)), rank_(rank), size_(size), stop_(std::move(stop)), sent_(size), received_(size) {}

    void connect(const NcclId& id) {
        ncclUniqueId unique;
        std::memcpy(&unique, &id, sizeof unique);
        ncclConfig_t config = NCCL_CONFIG_INITIALIZER;
        config.blocking = 0;
        or_break_off([&] {
            constexpr const char* kCall = "ncclCommInitRankConfig";
            nccl_check(nccl_, nccl_.comm_init_rank_config(&comm_, size_, unique, rank_, &config), kCall);
            wait_until([&] { return is_ready(kCall); });
        });
    }

    ~NcclLink() override {
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

    void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, RankDevice& device) override {
        if (!comm_) throw DeviceError(kEnded);
        std::vector<std::byte*> from(out.size()), to(in.size());
        for (std::size_t r = 0; r < out.size(); ++r) {
            if (int(r) == rank_) continue;
            from[r] = sent_.place(r, const_cast<std::byte*>(out[r].data()), out[r].size(), device);
            to[r] = received_.place(r, in[r].data(), in[r].size(), device);
            if (from[r] != out[r].data()) device.copy(from[r], out[r].data(), out[r].size());
        }
        const auto stream = static_cast<cudaStream_t>(device.stream());
        ncclResult_t result = nccl_.group_start();
        const char* what = "ncclGroupStart";
        const auto call = [&](const char* name, auto&& function) {
            if (result != ncclSuccess && result != ncclInProgress) return;
            what = name;
            result = function();
        };
        for (std::size_t r = 0; r < out.size(); ++r) {
            if (int(r) == rank_) continue;
            if (const std::size_t size = out[r].size(); size > 0)
                call("ncclSend", [&] { return nccl_.send(from[r], size, ncclInt8, int(r), comm_, stream); });
            if (const std::size_t size = in[r].size(); size > 0)
                call("ncclRecv", [&] { return nccl_.recv(to[r], size, ncclInt8, int(r), comm_, stream); });
        }
        const ncclResult_t end = nccl_.group_end();  // ends the group after an error, too
        call("ncclGroupEnd", [&] { return end; });
        or_break_off([&] {
            nccl_check(nccl_, result, what);
            // The transfer is on the stream when NCCL is ready, and not before.
            wait_until([&] { return is_ready("NCCL") && device.is_idle(); });
        });
        for (std::size_t r = 0; r < in.size(); ++r)
            if (int(r) != rank_ && to[r] != in[r].data()) device.copy(in[r].data(), to[r], in[r].size());
    }

  private:
    static constexpr const char* kEnded = "the connection to the other GPUs was ended";

    /// Returns whether NCCL has done what the last call asked for. Throws DeviceError where it failed, or where the
    /// connection has.
    bool is_ready(const char* what) {
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
        if (comm_) nccl_.comm_abort(comm_);
        comm_ = nullptr;
    }

    const NcclLibrary nccl_;
    const int rank_, size_;
    const std::stop_token stop_;
    ncclComm_t comm_ = nullptr;
    AlignedArrays sent_, received_;
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
