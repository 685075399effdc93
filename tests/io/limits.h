// SPDX-License-Identifier: Apache-2.0
// What tests of failing writes need: a child process with limits of its own.
#pragma once

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>

#include "kernels/base/error.h"

namespace gs::test {

/// Runs `f` in a child process, where limits can be set that would not go away again. Returns the child's exit status.
template <class F> int in_child(F&& f) {
    const pid_t child = ::fork();
    if (child == 0) ::_exit(f());
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// Lets no file grow beyond `bytes` from here on: write() fails after a short write, as on a full disk.
inline void limit_file_size(std::size_t bytes) {
    ::signal(SIGXFSZ, SIG_IGN);
    rlimit limit{};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = bytes;  // the soft limit, which can be raised again
    ::setrlimit(RLIMIT_FSIZE, &limit);
}

/// Returns 0 when `f` throws a DataError that contains both parts, 1 when it throws nothing, 2 for another message.
template <class F> int data_error_status(F&& f, const std::string& part, const std::string& other_part) {
    try {
        f();
        return 1;
    } catch (const DataError& e) {
        const std::string message = e.what();
        return message.find(part) != std::string::npos && message.find(other_part) != std::string::npos ? 0 : 2;
    }
}

}  // namespace gs::test
