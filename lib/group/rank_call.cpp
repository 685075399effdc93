// SPDX-License-Identifier: Apache-2.0
// Encodes requests and answers, and sends requests. Messages with their sizes in bytes:
//
//   answering rank    "gsapp r1", nonce (32)
//   requesting rank   size of the body (4), nonce (32), body, proof (32)
//   answering rank    status (1), size of the value (4), value, proof (32)
#include "lib/group/rank_call.h"

#include <fmt/format.h>
#include <netdb.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <thread>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/ranks/message.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

constexpr std::string_view kMagic = "gsapp r1";
constexpr std::size_t kNonceBytes = 32, kProofBytes = 32, kSizeBytes = sizeof(std::uint32_t);
constexpr std::size_t kHeadBytes = kSizeBytes + kNonceBytes;
/// The prefixes of the authenticated bytes, so that an answer cannot pass for a request.
constexpr std::string_view kAsks = "gsapp request", kAnswers = "gsapp answer";
/// The pause between two attempts to reach a rank, which may still be starting.
constexpr std::chrono::milliseconds kTryAgain(200);

std::string random_bytes(std::size_t size) {
    std::string bytes(size, '\0');
    if (::RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), int(size)) != 1)
        throw DeviceError("the system gives no random numbers for the connection of the ranks");
    return bytes;
}

std::string proof_of(const std::string& secret, std::string_view side, std::string_view nonces,
                     std::string_view content) {
    std::string all(side), proof(kProofBytes, '\0');
    all.append(nonces).append(content);
    unsigned int size = 0;
    if (!::HMAC(::EVP_sha256(), secret.data(), int(secret.size()), reinterpret_cast<const unsigned char*>(all.data()),
                all.size(), reinterpret_cast<unsigned char*>(proof.data()), &size) ||
        size != kProofBytes)
        throw DeviceError("HMAC-SHA256 is not available");
    return proof;
}

/// Compares in a time that does not depend on the position of the first difference.
bool equal(std::string_view a, std::string_view b) {
    return a.size() == b.size() && ::CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::string size_text(std::size_t size) {
    const auto value = std::uint32_t(size);
    return {reinterpret_cast<const char*>(&value), sizeof value};
}

std::size_t size_at(std::string_view bytes) {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes.data(), sizeof value);
    if (value > kLongestCall) throw DeviceError("what came is no message of a rank");
    return value;
}

std::string body_of(const RankRequest& request, const std::string& job) {
    const MessageWriter body =
        MessageWriter().put(request.call).put(request.rank).put(job).put(request.key).put(request.value);
    return {reinterpret_cast<const char*>(body.bytes().data()), body.bytes().size()};
}

/// A connection to another rank. Its functions throw DeviceError after the time limit.
class Connection {
  public:
    Connection(const RankAddress& address, double seconds) : end_(seconds_now() + seconds) {
        addrinfo hints{}, *found = nullptr;
        hints.ai_socktype = SOCK_STREAM;
        if (const int error = ::getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found))
            throw DeviceError(::gai_strerror(error));
        const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> list(found, &::freeaddrinfo);
        int error = 0;
        for (const addrinfo* a = found; a && !socket_.is_open(); a = a->ai_next) error = connect(*a);
        if (!socket_.is_open()) throw DeviceError(std::strerror(error));
    }

    void write(std::string_view bytes) {
        while (!bytes.empty()) {
            const ssize_t sent = ::send(socket_.fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
            if (moved(sent, POLLOUT)) bytes.remove_prefix(std::size_t(sent));
        }
    }
    std::string read(std::size_t size) {
        std::string bytes(size, '\0');
        for (std::size_t at = 0; at < size;) {
            const ssize_t received = ::recv(socket_.fd(), &bytes[at], size - at, 0);
            if (received == 0) throw DeviceError("the connection was closed");
            if (moved(received, POLLIN)) at += std::size_t(received);
        }
        return bytes;
    }
    Descriptor take() { return std::move(socket_); }

  private:
    /// Stores the open connection in socket_ and returns 0, or returns the error number.
    int connect(const addrinfo& to) {
        Descriptor socket(::socket(to.ai_family, to.ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, to.ai_protocol));
        if (!socket.is_open()) return errno;
        if (::connect(socket.fd(), to.ai_addr, to.ai_addrlen) != 0) {
            if (errno != EINPROGRESS) return errno;
            if (!ready(socket.fd(), POLLOUT)) return ETIMEDOUT;
            int error = 0;
            socklen_t size = sizeof error;
            if (::getsockopt(socket.fd(), SOL_SOCKET, SO_ERROR, &error, &size) != 0) return errno;
            if (error != 0) return error;
        }
        socket_ = std::move(socket);
        return 0;
    }
    /// Waits until the socket is ready. Returns false after the time limit.
    bool ready(int socket, short events) const {
        pollfd waits{socket, events, 0};
        while (true) {
            const int left = int(std::ceil(std::max(0.0, end_ - seconds_now()) * 1000));
            if (const int count = ::poll(&waits, 1, left); count > 0) return true;
            if (left == 0) return false;
        }
    }
    /// Returns whether a call of send or recv succeeded. If the call would block, waits until the socket is ready.
    bool moved(ssize_t count, short events) const {
        if (count >= 0) return true;
        if (errno != EAGAIN && errno != EINTR) throw DeviceError(std::strerror(errno));
        if (!ready(socket_.fd(), events)) throw DeviceError("no answer in time");
        return false;
    }

    const double end_;
    Descriptor socket_;
};

/// Sends one request and returns its answer.
RankAnswer ask_once(Connection& rank, const std::string& body, const std::string& secret) {
    const std::string greeting = rank.read(kMagic.size() + kNonceBytes);
    if (!greeting.starts_with(kMagic)) throw DeviceError("another program answers, or another version of gsapp");
    const std::string own_nonce = random_bytes(kNonceBytes), nonces = greeting.substr(kMagic.size()) + own_nonce;
    rank.write(size_text(body.size()) + own_nonce + body + proof_of(secret, kAsks, nonces, body));
    const std::string status = rank.read(1);
    if (RankAnswer::Status(status[0]) == RankAnswer::Status::kRefused) return {RankAnswer::Status::kRefused, ""};
    const std::string value = rank.read(size_at(rank.read(kSizeBytes)));
    // A rank without the secret cannot answer validly.
    if (!equal(rank.read(kProofBytes), proof_of(secret, kAnswers, nonces, status + value)))
        return {RankAnswer::Status::kRefused, ""};
    return {RankAnswer::Status(status[0]), value};
}

}  // namespace

RankAnswer ask(const RankAddress& address, const RankRequest& request, const Credentials& credentials, double patience,
               Descriptor* connection) {
    using Status = RankAnswer::Status;
    const std::string body = body_of(request, credentials.job);
    double spent = 0;
    while (true) {
        const double start = seconds_now();
        std::optional<RankAnswer> answer;
        std::string reason;
        try {
            Connection rank(address, kAnswerSeconds);
            answer = ask_once(rank, body, credentials.secret);
            if (connection) *connection = rank.take();
        } catch (const DeviceError& e) {
            reason = e.what();
        }
        if (answer && answer->status == Status::kOtherJob)
            throw DeviceError(
                fmt::format("rank {} found another job at {} port {}: two jobs must not have the same "
                            "MASTER_PORT there, and all ranks of one the same command",
                            request.rank, address.host, address.port));
        if (answer && answer->status == Status::kRefused)
            throw DeviceError(
                fmt::format("rank {} found ranks with another secret at {} port {}: all ranks of a job "
                            "need the same {}, or the same file ~/.config/gsapp/rank_secret",
                            request.rank, address.host, address.port, kSecretVariable));
        if (answer) return *answer;
        // An attempt takes no longer than kAnswerSeconds, unless this process was suspended meanwhile.
        spent += std::min(seconds_now() - start, kAnswerSeconds);
        if (spent >= patience)
            throw DeviceError(fmt::format("rank {} cannot reach rank {} at {} port {} ({})", request.rank, address.rank,
                                          address.host, address.port, reason));
        std::this_thread::sleep_for(kTryAgain);
        spent += std::chrono::duration<double>(kTryAgain).count();
    }
}

AnsweringSide::AnsweringSide(const Credentials& credentials)
    : credentials_(credentials), nonces_(random_bytes(kNonceBytes)) {}

std::string AnsweringSide::greeting() const { return std::string(kMagic) + nonces_.substr(0, kNonceBytes); }

std::size_t AnsweringSide::missing(std::string_view received) {
    if (received.size() < kHeadBytes) return kHeadBytes - received.size();
    return kHeadBytes + size_at(received) + kProofBytes - received.size();
}

std::optional<RankRequest> AnsweringSide::open(std::string_view received) {
    nonces_.resize(kNonceBytes);
    nonces_ += received.substr(kSizeBytes, kNonceBytes);
    const std::string_view body = received.substr(kHeadBytes, received.size() - kHeadBytes - kProofBytes),
                           proof = received.substr(received.size() - kProofBytes);
    if (!equal(proof, proof_of(credentials_.secret, kAsks, nonces_, body))) return std::nullopt;
    const auto bytes = std::as_bytes(std::span<const char>(body));
    MessageReader reader({bytes.begin(), bytes.end()});
    RankRequest request;
    std::string job;
    reader.get(request.call);
    reader.get(request.rank);
    reader.get(job);
    reader.get(request.key);
    reader.get(request.value);
    other_job_ = job != credentials_.job;
    return request;
}

std::string AnsweringSide::seal(const RankAnswer& answer) const {
    const std::string status(1, char(answer.status));
    if (answer.status == RankAnswer::Status::kRefused) return status;
    return status + size_text(answer.value.size()) + answer.value +
           proof_of(credentials_.secret, kAnswers, nonces_, status + answer.value);
}

}  // namespace gs
