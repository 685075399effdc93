// SPDX-License-Identifier: Apache-2.0
// posix_spawn with one pipe for stdout and stderr.
#include "lib/core/process.h"

#include <fcntl.h>
#include <spawn.h>
#include <spdlog/fmt/fmt.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "kernels/core/error.h"

extern char** environ;

namespace gs {
namespace {

constexpr std::size_t kKeptLines = 12;

/// environ with `added` replacing variables of the same name.
std::vector<std::string> merged_environment(const std::vector<std::pair<std::string, std::string>>& added) {
    std::vector<std::string> all;
    for (const auto& [name, value] : added) all.push_back(name + "=" + value);
    for (char** entry = environ; *entry; ++entry) {
        bool replaced = false;
        for (const auto& variable : added) replaced |= std::strncmp(*entry, (variable.first + "=").c_str(), variable.first.size() + 1) == 0;
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

pid_t start(const std::vector<std::string>& arguments, const std::vector<std::string>& environment, int output) {
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO);
    pid_t pid = 0;
    const int error = posix_spawnp(&pid, arguments[0].c_str(), &actions, nullptr, pointers(arguments).data(), pointers(environment).data());
    posix_spawn_file_actions_destroy(&actions);
    if (error == ENOENT) throw UsageError(fmt::format("the program '{}' is not installed or not on PATH", arguments[0]));
    if (error != 0) throw Error(ExitCode::kUnexpected, fmt::format("cannot start '{}': {}", arguments[0], std::strerror(error)));
    return pid;
}

/// Splits the stream at newlines and carriage returns (progress that programs overwrite in place).
void read_lines(int input, const std::function<void(const std::string&)>& on_line) {
    std::string line;
    char buffer[4096];
    for (;;) {
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

/// Closes a descriptor at the end of its scope, or earlier on request.
struct Descriptor {
    int fd;
    void close() {
        if (fd >= 0) ::close(fd);
        fd = -1;
    }
    ~Descriptor() { close(); }
};

}  // namespace

ProcessResult run_process(const std::vector<std::string>& arguments, const std::vector<std::pair<std::string, std::string>>& environment,
                          const std::function<void(const std::string&)>& on_line) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throw Error(ExitCode::kUnexpected, fmt::format("cannot make a pipe: {}", std::strerror(errno)));
    Descriptor input{ends[0]}, output{ends[1]};
    const pid_t child = start(arguments, merged_environment(environment), output.fd);
    output.close();
    ProcessResult result;
    try {
        read_lines(input.fd, [&](const std::string& line) {
            if (line.find_first_not_of(" \t") != std::string::npos) result.last_lines.push_back(line);
            if (result.last_lines.size() > kKeptLines) result.last_lines.erase(result.last_lines.begin());
            on_line(line);
        });
    } catch (...) {
        input.close();  // a child that still writes then ends by SIGPIPE instead of waiting for a reader
        wait_for(child);
        throw;
    }
    result.exit_code = wait_for(child);
    return result;
}

}  // namespace gs
