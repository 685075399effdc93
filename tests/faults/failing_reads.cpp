// SPDX-License-Identifier: Apache-2.0
// A library to preload into gsapp (LD_PRELOAD): reading one file fails beyond its first bytes, as on a disk that has a
// bad sector. Environment:
//   GSAPP_FAULT_FILE   the file
//   GSAPP_FAULT_AT     number of bytes that can be read
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <algorithm>

namespace {

/// Returns how many bytes can still be read from `fd`; -1 for other files.
off_t readable(int fd) {
    const char *const file = getenv("GSAPP_FAULT_FILE"), *const at = getenv("GSAPP_FAULT_AT");
    if (!file || !at) return -1;
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t size = readlink(link, path, sizeof path);
    if (size < 0 || size_t(size) != strlen(file) || memcmp(path, file, size_t(size)) != 0) return -1;
    return std::max<off_t>(0, atol(at) - lseek(fd, 0, SEEK_CUR));
}

}  // namespace

extern "C" ssize_t read(int fd, void* data, size_t size) {
    const off_t left = readable(fd);
    if (left == 0) {
        errno = EIO;
        return -1;
    }
    if (left > 0) size = std::min(size, size_t(left));
    return reinterpret_cast<ssize_t (*)(int, void*, size_t)>(dlsym(RTLD_NEXT, "read"))(fd, data, size);
}
