// SPDX-License-Identifier: Apache-2.0
// Locks a run folder with flock.
#include "lib/model/run_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "kernels/base/error.h"
#include "lib/core/log.h"

namespace gs {
namespace {

constexpr const char* kLockName = ".gsapp.lock";

bool same_file(const struct stat& a, const struct stat& b) { return a.st_dev == b.st_dev && a.st_ino == b.st_ino; }

/// Reads who holds the lock: " (process 123)"; empty where the file does not say.
std::string holder(int fd) {
    char digits[24] = {};
    const ssize_t size = ::pread(fd, digits, sizeof digits - 1, 0);
    const std::string text(digits, size > 0 ? std::size_t(size) : 0);
    const std::string pid = text.substr(0, text.find_first_not_of("0123456789"));
    return pid.empty() ? "" : " (process " + pid + ")";
}

}  // namespace

RunLock::RunLock(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::error_code error;
    std::filesystem::create_directories(folder_, error);
    if (error)
        throw DataError(fmt::format("cannot create the output folder '{}': {}", folder_.string(), error.message()));
    folder_fd_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder_fd_ < 0)
        throw DataError(fmt::format("cannot open the output folder '{}': {}", folder_.string(), std::strerror(errno)));
    try {
        lock_file();
    } catch (...) {
        if (file_fd_ >= 0) ::close(file_fd_);
        ::close(folder_fd_);
        throw;
    }
}

void RunLock::lock_file() {
    for (;;) {
        file_fd_ = ::openat(folder_fd_, kLockName, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        if (file_fd_ < 0)
            throw DataError(
                fmt::format("cannot write in the output folder '{}': {}; choose an output folder you may "
                            "write to",
                            folder_.string(), std::strerror(errno)));
        int result = 0;
        do {
            result = ::flock(file_fd_, LOCK_EX | LOCK_NB);
        } while (result != 0 && errno == EINTR);
        if (result != 0 && errno == EWOULDBLOCK)
            throw UsageError(
                fmt::format("another run{} writes into the output folder '{}'; choose another --model "
                            "folder, or wait until that run has ended",
                            holder(file_fd_), folder_.string()));
        if (result != 0)
            log_warning("'{}' cannot be locked ({}): make sure that no other run writes into it", folder_.string(),
                        std::strerror(errno));
        // A run that ended in between has removed the file that is now locked. Its successor is another file.
        struct stat locked {
        }, named{};
        if (::fstat(file_fd_, &locked) == 0 && ::fstatat(folder_fd_, kLockName, &named, 0) == 0 &&
            same_file(locked, named))
            break;
        ::close(file_fd_);
    }
    const std::string pid = std::to_string(::getpid()) + "\n";
    // For the message alone, so that a full disk is left to those who write results.
    if (::ftruncate(file_fd_, 0) != 0 || ::pwrite(file_fd_, pid.data(), pid.size(), 0) < 0) errno = 0;
}

RunLock::~RunLock() {
    ::unlinkat(folder_fd_, kLockName, 0);
    ::close(file_fd_);
    ::close(folder_fd_);
}

bool RunLock::is_held(const std::filesystem::path& folder) {
    const int fd = ::open((folder / kLockName).c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return false;
    const bool held = ::flock(fd, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    ::close(fd);
    return held;
}

void RunLock::check_folder() const {
    struct stat locked {
    }, named{};
    if (::fstat(folder_fd_, &locked) == 0 && ::stat(folder_.c_str(), &named) == 0 && same_file(locked, named)) return;
    throw DataError(
        fmt::format("the output folder '{}' was removed or replaced while the run wrote to it", folder_.string()));
}

}  // namespace gs
