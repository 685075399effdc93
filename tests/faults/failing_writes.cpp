// SPDX-License-Identifier: Apache-2.0
// A library to preload into gsapp (LD_PRELOAD): it counts the calls that change files below a folder, and makes one of
// them fail, or all from one on, as a full disk does. Environment:
//   GSAPP_FAULT_ROOT    the folder; calls on other files pass
//   GSAPP_FAULT_AT      number of the call that fails, from 1; 0 = none
//   GSAPP_FAULT_KEEP    1 = the calls after it fail as well, but for renames, which need no space
//   GSAPP_FAULT_ERROR   errno of the failure
//   GSAPP_FAULT_REPORT  file that gets one line a call: "PROCESS KIND PATH"
// Only the program gsapp is affected; the programs that it starts inherit the variables, but not the failures.
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <string>

namespace {

const char* setting(const char* name) {
    const char* text = getenv(name);
    return text ? text : "";
}

template <class Function> Function* original(const char* name) {
    return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

bool below_root(const std::string& path) {
    static const std::string root =
        strncmp(program_invocation_short_name, "gsapp", 5) == 0 ? setting("GSAPP_FAULT_ROOT") : "";
    return !root.empty() && path.compare(0, root.size() + 1, root + "/") == 0;
}

/// Whether this call is to fail; then errno is set.
bool fails(const char* kind, const std::string& path) {
    static std::atomic<long> calls{0};
    static const long at = atol(setting("GSAPP_FAULT_AT"));
    static const bool keep = *setting("GSAPP_FAULT_KEEP") == '1';
    if (!below_root(path)) return false;
    const long number = ++calls;
    static const char* const report = setting("GSAPP_FAULT_REPORT");
    if (*report) {
        // Directly, past the functions below.
        const long fd = syscall(SYS_openat, AT_FDCWD, report, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
        const std::string line = std::to_string(getpid()) + " " + kind + " " + path + "\n";
        if (fd >= 0) syscall(SYS_write, fd, line.data(), line.size()), syscall(SYS_close, fd);
    }
    const bool also = keep && number > at && strcmp(kind, "rename") != 0;
    if (at == 0 || (number != at && !also)) return false;
    errno = atoi(setting("GSAPP_FAULT_ERROR"));
    return true;
}

std::string path_of(int fd) {
    char path[PATH_MAX];
    const std::string link = "/proc/self/fd/" + std::to_string(fd);
    const ssize_t size = readlink(link.c_str(), path, sizeof path);
    return size > 0 ? std::string(path, size_t(size)) : "";
}

bool is_written(int fd) {
    struct stat status {};
    const int flags = fcntl(fd, F_GETFL);
    return flags >= 0 && (flags & O_ACCMODE) != O_RDONLY && fstat(fd, &status) == 0 && S_ISREG(status.st_mode);
}

bool fails_on(const char* kind, int fd) {
    const int before = errno;
    if (is_written(fd) && fails(kind, path_of(fd))) return true;
    errno = before;
    return false;
}

bool opens_for_writing(int flags) { return (flags & O_ACCMODE) != O_RDONLY || (flags & O_CREAT) != 0; }

int open_as(const char* name, const char* path, int flags, mode_t mode) {
    if (opens_for_writing(flags) && fails("open", path)) return -1;
    return original<int(const char*, int, ...)>(name)(path, flags, mode);
}

mode_t mode_of(int flags, va_list arguments) { return (flags & O_CREAT) != 0 ? va_arg(arguments, mode_t) : 0; }

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return open_as("open", path, flags, mode);
}
int open64(const char* path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return open_as("open64", path, flags, mode);
}
FILE* fopen(const char* path, const char* mode) {
    if (strpbrk(mode, "wa+") && fails("open", path)) return nullptr;
    return original<FILE*(const char*, const char*)>("fopen")(path, mode);
}
FILE* fopen64(const char* path, const char* mode) {
    if (strpbrk(mode, "wa+") && fails("open", path)) return nullptr;
    return original<FILE*(const char*, const char*)>("fopen64")(path, mode);
}
ssize_t write(int fd, const void* data, size_t size) {
    if (fails_on("write", fd)) return -1;
    return original<ssize_t(int, const void*, size_t)>("write")(fd, data, size);
}
ssize_t writev(int fd, const iovec* parts, int count) {
    if (fails_on("write", fd)) return -1;
    return original<ssize_t(int, const iovec*, int)>("writev")(fd, parts, count);
}
ssize_t pwrite(int fd, const void* data, size_t size, off_t at) {
    if (fails_on("write", fd)) return -1;
    return original<ssize_t(int, const void*, size_t, off_t)>("pwrite")(fd, data, size, at);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off64_t at) {
    if (fails_on("write", fd)) return -1;
    return original<ssize_t(int, const void*, size_t, off64_t)>("pwrite64")(fd, data, size, at);
}
int fflush(FILE* stream) {
    if (stream && fails_on("write", fileno(stream))) return EOF;
    return original<int(FILE*)>("fflush")(stream);
}
int fsync(int fd) {
    struct stat status {};
    if (fstat(fd, &status) == 0 && S_ISDIR(status.st_mode) ? fails("fsync", path_of(fd)) : fails_on("fsync", fd))
        return -1;
    return original<int(int)>("fsync")(fd);
}
int syncfs(int fd) noexcept {
    if (fails("fsync", path_of(fd))) return -1;
    return original<int(int)>("syncfs")(fd);
}
int close(int fd) {
    const bool failing = fails_on("close", fd);
    const int error = errno, result = original<int(int)>("close")(fd);
    if (!failing) return result;
    errno = error;
    return -1;
}
int rename(const char* from, const char* to) noexcept {
    if (fails("rename", to)) return -1;
    return original<int(const char*, const char*)>("rename")(from, to);
}
int mkdir(const char* path, mode_t mode) noexcept {
    if (fails("mkdir", path)) return -1;
    return original<int(const char*, mode_t)>("mkdir")(path, mode);
}

}  // extern "C"
