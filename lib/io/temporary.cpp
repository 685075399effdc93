// SPDX-License-Identifier: Apache-2.0
// Implements temporary files with flock, which works across containers that share folders but not process ids.
#include "lib/io/temporary.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "kernels/base/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

fs::path temporary_name(const fs::path& target) {
    static std::atomic<unsigned> counter{0};
    return target.parent_path() / fmt::format(".{}.{}-{}.tmp", target.filename().string(), ::getpid(), counter++);
}

/// Returns whether the name has exactly the form of `temporary_name`.
bool is_temporary_name(std::string_view name) {
    constexpr std::string_view kEnd = ".tmp";
    if (!name.starts_with('.') || !name.ends_with(kEnd)) return false;
    name = name.substr(1, name.size() - 1 - kEnd.size());
    const auto dot = name.rfind('.'), hyphen = name.rfind('-');
    if (dot == 0 || dot == std::string_view::npos || hyphen == std::string_view::npos || hyphen < dot) return false;
    const auto is_number = [](std::string_view text) {
        return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
    };
    return is_number(name.substr(dot + 1, hyphen - dot - 1)) && is_number(name.substr(hyphen + 1));
}

int lock(int fd, int operation) {
    int result;
    do result = ::flock(fd, operation);
    while (result != 0 && errno == EINTR);
    return result;
}

/// Takes the writer's lock. Returns false if `remove_leftovers` of another program removed the file between its
/// creation and this call. On file systems without locks returns true, because no program can remove the file there.
bool hold(int fd) {
    if (lock(fd, LOCK_EX) != 0) return true;
    struct stat status {};
    return ::fstat(fd, &status) != 0 || status.st_nlink > 0;
}

void remove_leftover(const fs::path& path) {
    std::error_code ignored;
    const fs::file_status status = fs::symlink_status(path, ignored);
    if (!fs::is_regular_file(status) && !fs::is_directory(status)) return;
    const int flags = fs::is_directory(status) ? O_RDONLY | O_DIRECTORY : O_RDWR;  // NFS locks need write access
    const int fd = ::open(path.c_str(), flags | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0) return;
    struct stat owner {};
    if (::fstat(fd, &owner) == 0 && owner.st_uid == ::geteuid() && lock(fd, LOCK_EX | LOCK_NB) == 0)
        fs::remove_all(path, ignored);
    ::close(fd);
}

/// Prepares the folder of a temporary file: creates it and, once per program run, removes its leftovers.
void prepare_folder(const fs::path& target) {
    static std::mutex mutex;
    static std::set<std::string> cleaned;
    const fs::path folder = target.parent_path();
    if (!folder.empty()) create_folders(folder, target);
    const std::lock_guard guard(mutex);
    if (cleaned.insert(folder.string()).second) remove_leftovers(folder);
}

}  // namespace

TemporaryFile create_temporary_file(const fs::path& target) {
    prepare_folder(target);
    for (TemporaryFile made;;) {
        made.path = temporary_name(target);
        made.fd = ::open(made.path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (made.fd >= 0 && hold(made.fd)) return made;
        if (made.fd < 0 && errno != EEXIST) fail_to_write("create", target, errno);
        if (made.fd >= 0) ::close(made.fd);
    }
}

WorkFolder::WorkFolder(const fs::path& target) {
    prepare_folder(target);
    for (;;) {
        path_ = temporary_name(target);
        if (::mkdir(path_.c_str(), 0777) != 0) {
            if (errno != EEXIST) fail_to_write("create a folder beside", target, errno);
            continue;
        }
        fd_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (fd_ >= 0 && hold(fd_)) return;
        if (fd_ < 0 && errno != ENOENT) fail_to_write("open a new folder beside", target, errno);
        if (fd_ >= 0) ::close(fd_);
    }
}

WorkFolder::~WorkFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    ::close(fd_);
}

fs::path own_temporary_folder() {
    const fs::path folder = fs::temp_directory_path() / fmt::format("gsapp-{}", ::getuid());
    ::mkdir(folder.c_str(), 0700);
    struct stat status = {};
    if (::lstat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode) || status.st_uid != ::getuid())
        throw DataError(
            fmt::format("{} cannot be used for temporary files: it is not a folder of this user", folder.string()));
    return folder;
}

void remove_leftovers(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> found;
    for (fs::directory_iterator it(folder.empty() ? "." : folder, error), end; !error && it != end; it.increment(error))
        if (is_temporary_name(it->path().filename().native())) found.push_back(it->path());
    for (const fs::path& path : found) remove_leftover(path);
}

void sync_folder(const fs::path& folder, const fs::path& target) {
    const int fd = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) {
        if (errno == EACCES) return;  // a folder may be writable but not listable
        fail_to_write("write the folder of", target, errno);
    }
    const int error = ::fsync(fd) == 0 ? 0 : errno;
    ::close(fd);
    // Other errors (EINVAL, ENOSYS, EBADF, EPERM, ...) come from network and FUSE file systems that cannot sync a
    // folder.
    if (error == EIO || error == ENOSPC || error == EDQUOT) fail_to_write("write the folder of", target, error);
}

void create_folders(const fs::path& folder, const fs::path& target) {
    std::error_code error;
    std::vector<fs::path> missing;
    for (fs::path at = folder; !at.empty() && !fs::exists(at, error); at = at.parent_path()) missing.push_back(at);
    fs::create_directories(folder, error);
    if (error) fail_to_write("create the folder of", target, error.value());
    for (const fs::path& made : missing) sync_folder(made.parent_path(), target);
}

void fail_to_write(const char* action, const fs::path& path, int error) {
    const char* hint = error == ENOSPC || error == EDQUOT ? "; free some space and run again"
                       : error == EACCES || error == EROFS || error == EPERM
                           ? "; choose an output folder you may write to"
                           : "";
    throw DataError(fmt::format("cannot {} '{}': {}{}", action, path.string(), std::strerror(error), hint));
}

}  // namespace gs
