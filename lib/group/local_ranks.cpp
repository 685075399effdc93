// SPDX-License-Identifier: Apache-2.0
// Starts and watches processes.
#include "lib/group/local_ranks.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <fstream>
#include <iterator>
#include <thread>

#include "kernels/base/error.h"
#include "lib/core/process.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

constexpr const char* kParent = "GSAPP_RANK_PARENT";
/// The time that ranks have to end by themselves.
constexpr std::chrono::seconds kLastWords(5);

/// Returns the arguments of this process.
std::vector<std::string> own_arguments() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    const std::string all((std::istreambuf_iterator<char>(file)), {});
    std::vector<std::string> arguments;
    for (std::size_t at = 0; at < all.size(); at += arguments.back().size() + 1) arguments.emplace_back(&all[at]);
    if (arguments.empty()) throw Error(ExitCode::kUnexpected, "cannot read /proc/self/cmdline to start more ranks");
    return arguments;
}

}  // namespace

LocalRanks::LocalRanks(int size, int port, const std::string& secret) {
    const std::vector<std::string> arguments = own_arguments();
    const std::string size_text = std::to_string(size);
    for (int rank = 1; rank < size; ++rank) {
        const std::string rank_text = std::to_string(rank);
        processes_.push_back({rank, start_process("/proc/self/exe", arguments,
                                                  {{"RANK", rank_text},
                                                   {"WORLD_SIZE", size_text},
                                                   {"LOCAL_RANK", rank_text},
                                                   {"LOCAL_WORLD_SIZE", size_text},
                                                   {"MASTER_ADDR", "127.0.0.1"},
                                                   {"MASTER_PORT", std::to_string(port)},
                                                   {"TORCHELASTIC_USE_AGENT_STORE", "False"},
                                                   {kSecretVariable, secret},
                                                   {kParent, std::to_string(::getpid())}})});
    }
}

LocalRanks::~LocalRanks() {
    const auto end = std::chrono::steady_clock::now() + kLastWords;
    for (Process& process : processes_)
        while (process.running && std::chrono::steady_clock::now() < end) {
            process.running = ::waitpid(process.pid, nullptr, WNOHANG) == 0;
            if (process.running) std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
    kill();
}

void LocalRanks::kill() {
    for (Process& process : processes_) {
        if (!process.running) continue;
        ::kill(process.pid, SIGKILL);
        ::waitpid(process.pid, nullptr, 0);
        process.running = false;
    }
}

std::optional<std::string> LocalRanks::first_lost() {
    for (Process& process : processes_) {
        int status = 0;
        if (!process.running || ::waitpid(process.pid, &status, WNOHANG) <= 0) continue;
        process.running = false;
        if (WIFSIGNALED(status))
            return fmt::format("rank {} was ended by signal {} ({}){}", process.rank, WTERMSIG(status),
                               ::strsignal(WTERMSIG(status)),
                               WTERMSIG(status) == SIGKILL ? "; perhaps memory ran out" : "");
        return fmt::format("rank {} ended with exit code {}", process.rank, WEXITSTATUS(status));
    }
    return std::nullopt;
}

void end_with_rank_0() {
    const char* parent = ::getenv(kParent);
    if (!parent) return;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (std::to_string(::getppid()) != parent) ::_exit(int(ExitCode::kUnexpected));  // it has already ended
}

}  // namespace gs
