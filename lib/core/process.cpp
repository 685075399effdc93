// SPDX-License-Identifier: Apache-2.0
// Runs programs with posix_spawn and one pipe for stdout and stderr.
#include "lib/core/process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>

#include "kernels/base/descriptor.h"
#include "kernels/base/error.h"

extern char** environ;

namespace gs {
namespace {

constexpr std::size_t kKeptLines = 12;
constexpr int kAskEvery = 100;  // ms

/// Returns environ with `added` replacing variables of the same name.
std::vector<std::string> merged_environment(const std::vector<std::pair<std::string, std::string>>& added) {
    std::vector<std::string> all;
    for (const auto& [name, value] : added) all.push_back(name + "=" + value);
    for (char** entry = environ; *entry; ++entry) {
        bool replaced = false;
        for (const auto& variable : added)
            replaced |= std::strncmp(*entry, (variable.first + "=").c_str(), variable.first.size() + 1) == 0;
        if (!replaced) all.push_back(*entry);
    }
    return all;
}

std::vector<char*> pointers(const std::vector<std::string>& texts) {
    std::vector<char*> out;
    for (const std::string& text : texts) out.push_back(const_cast<char*>(text.c_str()));
    out.push_back(nullptr);
    return out;
}

/// Starts a program whose stdout and stderr go to `output`; if that is empty, stdout is discarded and stderr is shared.
pid_t start(const std::string& program, const std::vector<std::string>& arguments,
            const std::vector<std::string>& environment, std::optional<int> output, bool own_group) {
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);  // the default process group, 0, means a new group
    posix_spawnattr_setflags(&attributes, short(POSIX_SPAWN_SETSIGDEF | (own_group ? POSIX_SPAWN_SETPGROUP : 0)));
    sigset_t defaults;  // this program may ignore these signals; other programs expect to end by them
    sigemptyset(&defaults);
    sigaddset(&defaults, SIGPIPE);
    sigaddset(&defaults, SIGXFSZ);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    if (output) {
        posix_spawn_file_actions_adddup2(&actions, *output, STDOUT_FILENO);
        posix_spawn_file_actions_adddup2(&actions, *output, STDERR_FILENO);
    } else {
        posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    }
    pid_t pid = 0;
    const int error = posix_spawnp(&pid, program.c_str(), &actions, &attributes, pointers(arguments).data(),
                                   pointers(environment).data());
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (error == ENOENT) throw UsageError(fmt::format("the program '{}' is not installed or not on PATH", program));
    if (error != 0)
        throw Error(ExitCode::kUnexpected, fmt::format("cannot start '{}': {}", program, std::strerror(error)));
    return pid;
}

/// Waits for input. Returns whether `stop` returned true first.
bool wait_for_input(int input, const std::function<bool()>& stop) {
    pollfd ready{input, POLLIN, 0};
    while (!stop())
        if (::poll(&ready, 1, kAskEvery) > 0) return false;
    return true;
}

/// Splits the stream into lines at newlines and at carriage returns, with which programs overwrite progress in place.
void read_lines(int input, pid_t pid, const std::function<void(const std::string&)>& on_line,
                std::function<bool()> stop) {
    std::string line;
    char buffer[4096];
    for (;;) {
        if (stop && wait_for_input(input, stop)) {
            ::kill(pid, SIGINT);
            stop = {};  // a second signal would end the program before it has saved
        }
        const ssize_t n = ::read(input, buffer, sizeof buffer);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) break;
        for (ssize_t i = 0; i < n; ++i) {
            if (buffer[i] != '\n' && buffer[i] != '\r') {
                line += buffer[i];
            } else if (!line.empty()) {
                on_line(line);
                line.clear();
            }
        }
    }
    if (!line.empty()) on_line(line);
}

int wait_for(pid_t pid) {
    int status = 0;
    while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

pid_t start_process(const std::string& program, const std::vector<std::string>& arguments,
                    const std::vector<std::pair<std::string, std::string>>& environment) {
    return start(program, arguments, merged_environment(environment), std::nullopt, false);
}

ProcessResult run_process(const std::vector<std::string>& arguments,
                          const std::vector<std::pair<std::string, std::string>>& environment,
                          const std::function<void(const std::string&)>& on_line, const std::function<bool()>& stop) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0)
        throw Error(ExitCode::kUnexpected, fmt::format("cannot make a pipe: {}", std::strerror(errno)));
    Descriptor input(ends[0]), output(ends[1]);
    const pid_t child = start(arguments[0], arguments, merged_environment(environment), output.fd(), bool(stop));
    output.close();
    ProcessResult result;
    try {
        const auto keep_line = [&](const std::string& line) {
            if (line.find_first_not_of(" \t") != std::string::npos) result.last_lines.push_back(line);
            if (result.last_lines.size() > kKeptLines) result.last_lines.erase(result.last_lines.begin());
            on_line(line);
        };
        read_lines(input.fd(), child, keep_line, stop);
    } catch (...) {
        input.close();  // a child that is still writing then ends by SIGPIPE instead of waiting for a reader
        wait_for(child);
        throw;
    }
    result.exit_code = wait_for(child);
    return result;
}

}  // namespace gs
