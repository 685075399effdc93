// SPDX-License-Identifier: Apache-2.0
// Keeps the roster, serves it and asks for it with cpp-httplib.
#include "lib/ranks/roster.h"

#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>

#include <chrono>
#include <thread>
#include <utility>

#include "kernels/core/clock.h"
#include "kernels/core/error.h"

namespace gs {
namespace {

/// The longest pause between two looks at the ranks, seconds; in a longer one this process did not run.
constexpr double kLongestPause = 3;
/// How long a request for a value waits before it is asked again, and the status of an answer that has none yet.
constexpr double kWaitForValue = 2;
constexpr int kNotYet = 404;
/// The status of every answer after a failure, whose text is the answer.
constexpr int kFailed = 410;
/// The header by which a rank says of which job it is, and the status of every answer to one of another.
constexpr const char* kJobHeader = "Gsapp-Job";
constexpr int kOtherJob = 409;
/// The seconds that rank 0 may take to answer.
constexpr int kAnswerTime = 10;
/// Between two tries to reach rank 0, which may still be starting.
constexpr std::chrono::milliseconds kTryAgain(200);

/// Returns a job's name as a header can hold it (64-bit FNV-1a).
std::string job_number(const std::string& job) {
    std::uint64_t hash = 0xcbf29ce484222325ull;
    for (const char c : job) hash = (hash ^ std::uint8_t(c)) * 0x100000001b3ull;
    return fmt::format("{:016x}", hash);
}

}  // namespace

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
        // While this process was stopped, or its machine asleep, it heard of nobody.
        if (std::exchange(last_look_, now) + kLongestPause < now)
            for (Heard& heard : heard_) heard.seconds = heard.seconds > 0 ? now : 0;
        for (std::size_t r = 1; r < heard_.size(); ++r) {
            const Heard& heard = heard_[r];
            if (heard.seconds == 0 && now - start_ > kLongestWait)
                message = fmt::format("rank {} of {} did not come within {:g} s", r, heard_.size(), kLongestWait);
            else if (heard.seconds > 0 && now - heard.seconds > kLongestSilence)
                message = fmt::format("rank {} on {} has not been heard of for {:g} s: it hangs, or its machine does",
                                      r, heard.host, kLongestSilence);
        }
    }
    if (!message.empty()) fail(message);
}

struct RosterServer::Implementation {
    httplib::Server server;
    std::thread thread;
    int port = 0;
};

RosterServer::RosterServer(Roster& roster, const std::string& address, int port, const std::string& job)
    : implementation_(std::make_unique<Implementation>()) {
    httplib::Server& server = implementation_->server;
    // Replaces the library's own option, with which two servers would share a port.
    server.set_socket_options([](socket_t socket) {
        const int yes = 1;
        ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    const auto answer = [&roster](httplib::Response& response) {
        const std::string failure = roster.failure();
        if (failure.empty()) return;
        response.status = kFailed;
        response.set_content(failure, "text/plain");
    };
    // Every rank may wait for a value while it also reports.
    const std::size_t threads = 2 * std::size_t(roster.size());
    server.new_task_queue = [threads] { return new httplib::ThreadPool(threads); };
    server.set_pre_routing_handler(
        [own = job_number(job)](const httplib::Request& request, httplib::Response& response) {
            if (request.get_header_value(kJobHeader) == own) return httplib::Server::HandlerResponse::Unhandled;
            response.status = kOtherJob;
            return httplib::Server::HandlerResponse::Handled;
        });
    server.Post("/value", [&roster, answer](const httplib::Request& request, httplib::Response& response) {
        roster.set(request.get_param_value("key"), {request.body.begin(), request.body.end()});
        answer(response);
    });
    server.Get("/value", [&roster, answer](const httplib::Request& request, httplib::Response& response) {
        if (const auto value = roster.get(request.get_param_value("key"), kWaitForValue))
            response.set_content(std::string(value->begin(), value->end()), "application/octet-stream");
        else
            response.status = kNotYet;
        answer(response);
    });
    server.Post("/alive", [&roster, answer](const httplib::Request& request, httplib::Response& response) {
        roster.hear_of(std::atoi(request.get_param_value("rank").c_str()), request.get_param_value("host"));
        answer(response);
    });
    server.Post("/failed",
                [&roster](const httplib::Request& request, httplib::Response&) { roster.fail(request.body); });
    implementation_->port =
        port == 0 ? server.bind_to_any_port(address) : (server.bind_to_port(address, port) ? port : -1);
    if (implementation_->port <= 0)
        throw DeviceError(
            fmt::format("rank 0 cannot listen on port {} of {}: it is taken, or not allowed", port, address));
    implementation_->thread = std::thread([&running = implementation_->server] { running.listen_after_bind(); });
    while (!server.is_running())
        std::this_thread::sleep_for(std::chrono::milliseconds(1));  // or stop() would not stop it
}

RosterServer::~RosterServer() {
    implementation_->server.stop();
    implementation_->thread.join();
}

int RosterServer::port() const { return implementation_->port; }

struct RosterClient::Implementation {
    int rank;
    std::string master;
    int port;
    std::string job;  ///< job_number

    /// Calls request(client) until there is an answer. Throws DeviceError when rank 0 is silent for too long.
    template <class Fn> httplib::Result ask(Fn&& request, double patience) const {
        const double start = seconds_now();
        while (true) {
            httplib::Client client(master, port);  // one for each, so that threads can ask at once
            client.set_connection_timeout(kAnswerTime);
            client.set_read_timeout(kAnswerTime);
            client.set_default_headers({{kJobHeader, job}});
            if (httplib::Result result = request(client)) {
                if (result->status != kOtherJob) return result;
                throw DeviceError(
                    fmt::format("rank {} found another job at {} port {}: two jobs must not have the same MASTER_PORT "
                                "there, and all ranks of one the same command",
                                rank, master, port));
            }
            if (seconds_now() - start > patience)
                throw DeviceError(fmt::format("rank {} cannot reach rank 0 at {} port {}", rank, master, port));
            std::this_thread::sleep_for(kTryAgain);
        }
    }
};

RosterClient::RosterClient(int rank, const std::string& master, int port, const std::string& job)
    : implementation_(std::make_unique<Implementation>(Implementation{rank, master, port, job_number(job)})) {}
RosterClient::~RosterClient() = default;

void RosterClient::set(const std::string& key, const std::vector<char>& value) {
    const std::string path = httplib::append_query_params("/value", {{"key", key}}), body(value.begin(), value.end());
    implementation_->ask([&](httplib::Client& c) { return c.Post(path, body, "application/octet-stream"); },
                         kLongestSilence);
}

std::vector<char> RosterClient::get(const std::string& key) {
    const std::string path = httplib::append_query_params("/value", {{"key", key}});
    while (true) {
        const auto result = implementation_->ask([&](httplib::Client& c) { return c.Get(path); }, kLongestSilence);
        if (result->status == 200) return {result->body.begin(), result->body.end()};
        if (result->status == kFailed) throw DeviceError(result->body);
    }
}

std::string RosterClient::report(const std::string& host, double patience) {
    const std::string path =
        httplib::append_query_params("/alive", {{"rank", std::to_string(implementation_->rank)}, {"host", host}});
    const auto result = implementation_->ask([&](httplib::Client& c) { return c.Post(path); }, patience);
    return result->status == kFailed ? result->body : "";
}

void RosterClient::fail(const std::string& message) {
    implementation_->ask([&](httplib::Client& c) { return c.Post("/failed", message, "text/plain"); }, 0);
}

}  // namespace gs
