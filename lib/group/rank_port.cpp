// SPDX-License-Identifier: Apache-2.0
// Keeps the roster on rank 0, and queries it from other ranks. The port answers in one thread, which never blocks on a
// single connection.
#include "lib/group/rank_port.h"

#include <fmt/format.h>
#include <netdb.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <exception>
#include <list>
#include <thread>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

/// The seconds that a request for a missing value waits before it must be repeated.
constexpr double kWaitForValue = 2;
/// The milliseconds between two checks for requests that can now be answered, and for connections past their deadline.
constexpr int kLookForValue = 20, kLookForLate = 500;
/// The largest number of unauthenticated connections, besides two for each rank.
constexpr std::size_t kMostStrangers = 64;

Descriptor listen_at(const std::string& address, int port) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_NUMERICHOST | AI_PASSIVE;
    if (::getaddrinfo(address.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) {
        errno = EADDRNOTAVAIL;
        return Descriptor();
    }
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> list(found, &::freeaddrinfo);
    Descriptor socket(::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, found->ai_protocol));
    const int yes = 1;  // connections of an earlier job may still be in TIME_WAIT
    if (socket.is_open() &&
        (::setsockopt(socket.fd(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
         ::bind(socket.fd(), found->ai_addr, found->ai_addrlen) != 0 || ::listen(socket.fd(), SOMAXCONN) != 0)) {
        const int error = errno;
        socket.close();
        errno = error;
    }
    return socket;
}

int port_of(int socket) {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    char port[NI_MAXSERV] = {};
    if (::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0 ||
        ::getnameinfo(reinterpret_cast<sockaddr*>(&address), size, nullptr, 0, port, sizeof port, NI_NUMERICSERV) != 0)
        return 0;
    return std::atoi(port);
}

/// The longest normal pause between two checks of the ranks, seconds; in a longer pause this process was suspended.
constexpr double kLongestPause = 3;

}  // namespace

struct RankPort::Implementation {
    /// One connection, from the greeting to the answer.
    struct Visitor {
        Descriptor socket;
        AnsweringSide side;
        double deadline;                     ///< time at which it is dropped, or its request answered with kNotYet
        std::string out, in;                 ///< bytes to send, and bytes received
        std::optional<RankRequest> request;  ///< set once the connection has proved to be a rank
        std::optional<RankAnswer> answer;

        bool is_stranger() const { return !request; }
        bool waits_for_answer() const { return request && !answer; }

        /// Sends as much as possible. Returns false if the connection is broken.
        bool write() {
            while (!out.empty()) {
                const ssize_t sent = ::send(socket.fd(), out.data(), out.size(), MSG_NOSIGNAL);
                if (sent < 0) return errno == EAGAIN || errno == EINTR;
                out.erase(0, std::size_t(sent));
            }
            return true;
        }
        /// Reads up to the end of the request. Returns false if the connection is broken or was closed.
        bool read() {
            while (const std::size_t missing = AnsweringSide::missing(in)) {
                const std::size_t before = in.size();
                in.resize(before + std::min(missing, std::size_t(1) << 16));
                const ssize_t received = ::recv(socket.fd(), &in[before], in.size() - before, 0);
                const int error = errno;
                in.resize(before + std::size_t(std::max<ssize_t>(received, 0)));
                if (received == 0) return false;
                if (received < 0) return error == EAGAIN || error == EINTR;
            }
            return true;
        }
    };

    const Credentials credentials;
    const Handler handler;
    const std::size_t most_strangers;
    const Descriptor listening, wake;
    std::list<Visitor> visitors;  ///< connections in order of arrival
    std::mutex mutex;
    std::condition_variable arrived_changed;
    std::map<int, Descriptor> arrived;  ///< requested connections by rank
    std::atomic<bool> ending = false;
    std::thread thread;

    Implementation(const Credentials& credentials_, Handler handler_, int size, Descriptor listening_, Descriptor wake_)
        : credentials(credentials_),
          handler(std::move(handler_)),
          most_strangers(kMostStrangers + 2 * std::size_t(size)),
          listening(std::move(listening_)),
          wake(std::move(wake_)),
          thread([this] { run(); }) {}

    void run() {
        while (!ending) {
            wait();
            const double now = seconds_now();
            try {
                accept_all(now);
            } catch (const std::exception&) {  // out of memory: later connections may succeed
            }
            for (auto visitor = visitors.begin(); visitor != visitors.end();)
                visitor = advance(*visitor, now) ? std::next(visitor) : visitors.erase(visitor);
        }
    }

    /// Waits until a connection may need attention.
    void wait() const {
        std::vector<pollfd> all{{wake.fd(), POLLIN, 0}, {listening.fd(), POLLIN, 0}};
        int time = visitors.empty() ? -1 : kLookForLate;
        for (const Visitor& visitor : visitors) {
            if (visitor.waits_for_answer())
                time = kLookForValue;
            else
                all.push_back({visitor.socket.fd(), short(visitor.out.empty() ? POLLIN : POLLOUT), 0});
        }
        ::poll(all.data(), all.size(), time);
    }

    void accept_all(double now) {
        while (true) {
            Descriptor socket(::accept4(listening.fd(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
            if (!socket.is_open()) {
                if (errno == EINTR || errno == ECONNABORTED) continue;
                if (errno == EAGAIN || drop_oldest_stranger()) return;
                std::this_thread::sleep_for(std::chrono::milliseconds(kLookForValue));  // no file descriptor is free
                return;
            }
            visitors.push_back({std::move(socket), AnsweringSide(credentials), now + kAnswerSeconds, "", "", {}, {}});
            visitors.back().out = visitors.back().side.greeting();
            const auto strangers =
                std::count_if(visitors.begin(), visitors.end(), [](const Visitor& v) { return v.is_stranger(); });
            if (std::size_t(strangers) > most_strangers) drop_oldest_stranger();
        }
    }

    bool drop_oldest_stranger() {
        const auto oldest =
            std::find_if(visitors.begin(), visitors.end(), [](const Visitor& v) { return v.is_stranger(); });
        if (oldest == visitors.end()) return false;
        visitors.erase(oldest);
        return true;
    }

    /// Advances a connection as far as possible without blocking. Returns false if the connection is to be removed.
    bool advance(Visitor& visitor, double now) {
        try {
            if (!visitor.write()) return false;
            if (visitor.is_stranger() && !visitor.answer) {
                if (!visitor.read()) return false;
                if (AnsweringSide::missing(visitor.in) == 0) admit(visitor, now);
            }
            if (visitor.waits_for_answer()) {
                visitor.answer = answer_to(*visitor.request);
                if (!visitor.answer && now > visitor.deadline) visitor.answer = {RankAnswer::Status::kNotYet, ""};
                if (!visitor.answer) return true;
                visitor.out = visitor.side.seal(*visitor.answer);
                visitor.deadline = now + kAnswerSeconds;
            }
            if (!visitor.write() || now > visitor.deadline) return false;
        } catch (const std::exception&) {  // invalid request, or out of memory
            return false;
        }
        if (!visitor.answer || !visitor.out.empty()) return true;
        if (visitor.request && visitor.request->call == RankRequest::Call::kConnect &&
            visitor.answer->status == RankAnswer::Status::kOk) {
            const std::lock_guard lock(mutex);
            arrived[visitor.request->rank] = std::move(visitor.socket);
            arrived_changed.notify_all();
        }
        return false;
    }

    /// Checks the proof of a complete request.
    void admit(Visitor& visitor, double now) {
        visitor.request = visitor.side.open(visitor.in);
        visitor.in.clear();
        if (!visitor.request)
            visitor.answer = {RankAnswer::Status::kRefused, ""};
        else if (visitor.side.is_of_other_job())
            visitor.answer = {RankAnswer::Status::kOtherJob, ""};
        visitor.deadline = now + (visitor.answer ? kAnswerSeconds : kWaitForValue);
        if (visitor.answer) visitor.out = visitor.side.seal(*visitor.answer);
    }

    std::optional<RankAnswer> answer_to(const RankRequest& request) const {
        if (request.call == RankRequest::Call::kConnect) return RankAnswer{};
        return handler ? handler(request) : RankAnswer{RankAnswer::Status::kRefused, ""};
    }
};

RankPort::RankPort(const std::string& address, int port, int rank, int size, const Credentials& credentials,
                   Handler handler) {
    Descriptor listening = listen_at(address, port);
    if (!listening.is_open())
        throw DeviceError(fmt::format("rank {} cannot listen on port {} of {}: it is taken, or not allowed ({})", rank,
                                      port, address, std::strerror(errno)));
    Descriptor wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    if (!wake.is_open()) throw DeviceError(fmt::format("rank {} cannot listen: {}", rank, std::strerror(errno)));
    implementation_ =
        std::make_unique<Implementation>(credentials, std::move(handler), size, std::move(listening), std::move(wake));
}

RankPort::~RankPort() {
    implementation_->ending = true;
    ::eventfd_write(implementation_->wake.fd(), 1);
    implementation_->thread.join();
}

int RankPort::port() const { return port_of(implementation_->listening.fd()); }

std::optional<Descriptor> RankPort::take(int rank, double seconds) {
    Implementation& port = *implementation_;
    std::unique_lock lock(port.mutex);
    const auto is_there = [&] { return port.arrived.contains(rank); };
    if (!port.arrived_changed.wait_for(lock, std::chrono::duration<double>(seconds), is_there)) return std::nullopt;
    return std::move(port.arrived.extract(rank).mapped());
}

Roster::Roster(int size) : heard_(std::size_t(size)), start_(seconds_now()), last_look_(start_) {}

void Roster::set(const std::string& key, const std::vector<char>& value) {
    const std::lock_guard lock(mutex_);
    values_[key] = value;
    changed_.notify_all();
}

std::optional<std::vector<char>> Roster::get(const std::string& key, double seconds) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                      [&] { return !failure_.empty() || values_.contains(key); });
    if (!failure_.empty() || !values_.contains(key)) return std::nullopt;
    return values_[key];
}

void Roster::hear_of(int rank, const std::string& host) {
    const std::lock_guard lock(mutex_);
    if (rank >= 0 && rank < int(heard_.size())) heard_[std::size_t(rank)] = {seconds_now(), host};
}

void Roster::fail(const std::string& message) {
    const std::lock_guard lock(mutex_);
    if (failure_.empty()) failure_ = message;
    changed_.notify_all();
}

std::string Roster::failure() const {
    const std::lock_guard lock(mutex_);
    return failure_;
}

void Roster::look_for_lost_ranks() {
    std::string message;
    {
        const std::lock_guard lock(mutex_);
        const double now = seconds_now();
        // While this process or its machine was suspended, it received no reports.
        if (std::exchange(last_look_, now) + kLongestPause < now)
            for (Heard& heard : heard_) heard.seconds = heard.seconds > 0 ? now : 0;
        for (std::size_t r = 1; r < heard_.size(); ++r) {
            const Heard& heard = heard_[r];
            if (heard.seconds == 0 && now - start_ > kLongestWait)
                message = fmt::format(
                    "rank {} of {} did not come within {:g} s: it was not started, cannot reach this machine, or has "
                    "another secret ({})",
                    r, heard_.size(), kLongestWait, kSecretVariable);
            else if (heard.seconds > 0 && now - heard.seconds > kLongestSilence)
                message = fmt::format("rank {} on {} has not been heard of for {:g} s: it hangs, or its machine does",
                                      r, heard.host, kLongestSilence);
        }
    }
    if (!message.empty()) fail(message);
}

RankPort::Handler answers_of(Roster& roster) {
    return [&roster](const RankRequest& request) -> std::optional<RankAnswer> {
        using Call = RankRequest::Call;
        if (request.call == Call::kSet) roster.set(request.key, {request.value.begin(), request.value.end()});
        if (request.call == Call::kReport) roster.hear_of(request.rank, request.value);
        if (request.call == Call::kFail) roster.fail(request.value);
        if (std::string failure = roster.failure(); !failure.empty())
            return RankAnswer{RankAnswer::Status::kFailed, std::move(failure)};
        if (request.call != Call::kGet) return RankAnswer{};
        const auto value = roster.get(request.key, 0);
        if (!value) return std::nullopt;
        return RankAnswer{RankAnswer::Status::kOk, {value->begin(), value->end()}};
    };
}

RankAnswer RosterClient::ask_rank_0(RankRequest::Call call, const std::string& key, const std::string& value,
                                    double patience) const {
    return ask(address_, {call, rank_, key, value}, credentials_, patience);
}

void RosterClient::set(const std::string& key, const std::vector<char>& value) {
    ask_rank_0(RankRequest::Call::kSet, key, {value.begin(), value.end()}, kLongestSilence);
}

std::vector<char> RosterClient::get(const std::string& key) {
    while (true) {
        const RankAnswer answer = ask_rank_0(RankRequest::Call::kGet, key, "", kLongestSilence);
        if (answer.status == RankAnswer::Status::kOk) return {answer.value.begin(), answer.value.end()};
        if (answer.status == RankAnswer::Status::kFailed) throw DeviceError(answer.value);
    }
}

std::string RosterClient::report(const std::string& host, double patience) {
    const RankAnswer answer = ask_rank_0(RankRequest::Call::kReport, "", host, patience);
    return answer.status == RankAnswer::Status::kFailed ? answer.value : "";
}

void RosterClient::fail(const std::string& message) { ask_rank_0(RankRequest::Call::kFail, "", message, 0); }

}  // namespace gs
