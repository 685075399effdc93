// SPDX-License-Identifier: Apache-2.0
// Exchanges bytes through Gloo's unbound buffers.
#include "kernels/ranks/gloo_communicator.h"

#include <gloo/rendezvous/context.h>
#include <gloo/rendezvous/store.h>
#include <gloo/transport/tcp/device.h>
#include <gloo/transport/unbound_buffer.h>

#include <mutex>

#include "kernels/core/error.h"

namespace gs {
namespace {

using Buffer = gloo::transport::UnboundBuffer;

/// A rank may compute or write files for long while others wait for it; who finds that one is gone calls abort().
constexpr std::chrono::hours kPatience{24 * 365};
constexpr const char* kEnded = "the connection to the other ranks was ended";

/// Shows Gloo the meeting place.
class Store final : public gloo::rendezvous::Store {
  public:
    explicit Store(MeetingPlace& place) : place_(place) {}
    void set(const std::string& key, const std::vector<char>& value) override { place_.set(key, value); }
    std::vector<char> get(const std::string& key) override { return place_.get(key); }
    void wait(const std::vector<std::string>& keys) override {
        for (const std::string& key : keys) place_.get(key);
    }
    void wait(const std::vector<std::string>& keys, const std::chrono::milliseconds&) override { wait(keys); }

  private:
    MeetingPlace& place_;
};

class GlooCommunicator final : public Communicator {
  public:
    GlooCommunicator(std::shared_ptr<gloo::Context> context, int rank, int size)
        : Communicator(rank, size), context_(std::move(context)) {}

  private:
    void break_off() override {
        const std::lock_guard lock(mutex_);
        aborted_ = true;
        if (!waits_for_) return;
        waits_for_->abortWaitSend();
        waits_for_->abortWaitRecv();
    }

    void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) override {
        {
            const std::lock_guard lock(mutex_);
            if (aborted_) throw DeviceError(kEnded);  // nothing is sent that nobody expects
        }
        const auto self = std::size_t(rank());
        if (!out[self].empty() && !in[self].empty()) std::memcpy(in[self].data(), out[self].data(), in[self].size());
        std::vector<std::unique_ptr<Buffer>> receives, sends;
        try {
            for (std::size_t r = 0; r < in.size(); ++r) {
                if (r == self || in[r].empty()) continue;
                receives.push_back(context_->createUnboundBuffer(in[r].data(), in[r].size()));
                receives.back()->recv(int(r), 0);
            }
            for (std::size_t r = 0; r < out.size(); ++r) {
                if (r == self || out[r].empty()) continue;
                // Gloo writes to no buffer that it sends.
                sends.push_back(context_->createUnboundBuffer(const_cast<std::byte*>(out[r].data()), out[r].size()));
                sends.back()->send(int(r), 0);
            }
            for (auto& buffer : sends) wait_for(*buffer, [](Buffer& b) { return b.waitSend(kPatience); });
            for (auto& buffer : receives) wait_for(*buffer, [](Buffer& b) { return b.waitRecv(kPatience); });
        } catch (const Error&) {
            throw;
        } catch (const std::exception& e) {  // of Gloo, whose checks throw other types than its connections
            throw DeviceError(std::string("the connection to another rank broke (") + e.what() + ")");
        }
    }

    template <class Wait> void wait_for(Buffer& buffer, Wait&& wait) {
        const Waiting waiting(*this, buffer);
        if (!wait(buffer)) throw DeviceError(kEnded);
    }

    /// Shows abort() the buffer that is waited for, as long as there is one.
    class Waiting {
      public:
        Waiting(GlooCommunicator& owner, Buffer& buffer) : owner_(owner) {
            const std::lock_guard lock(owner_.mutex_);
            if (owner_.aborted_) throw DeviceError(kEnded);
            owner_.waits_for_ = &buffer;
        }
        ~Waiting() {
            const std::lock_guard lock(owner_.mutex_);
            owner_.waits_for_ = nullptr;
        }

      private:
        GlooCommunicator& owner_;
    };

    const std::shared_ptr<gloo::Context> context_;
    std::mutex mutex_;
    Buffer* waits_for_ = nullptr;
    bool aborted_ = false;
};

}  // namespace

std::unique_ptr<Communicator> connect_with_gloo(MeetingPlace& place, int rank, int size, const std::string& host) {
    try {
        auto device = gloo::transport::tcp::CreateDevice(gloo::transport::tcp::attr(host.c_str()));
        auto context = std::make_shared<gloo::rendezvous::Context>(rank, size);
        Store store(place);
        context->connectFullMesh(store, device);
        context->setTimeout(kPatience);
        return std::make_unique<GlooCommunicator>(std::move(context), rank, size);
    } catch (const Error&) {
        throw;
    } catch (const std::exception& e) {
        throw DeviceError("rank " + std::to_string(rank) + " cannot reach the other ranks (" + e.what() + ")");
    }
}

}  // namespace gs
