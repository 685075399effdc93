// SPDX-License-Identifier: Apache-2.0
// Checks and reads files.
#include "lib/core/input_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

const char* kind_word(fs::file_type type) {
    switch (type) {
        case fs::file_type::directory:
            return "a folder";
        case fs::file_type::fifo:
            return "a named pipe (FIFO)";
        case fs::file_type::character:
        case fs::file_type::block:
            return "a device";
        case fs::file_type::socket:
            return "a socket";
        default:
            return "a special file";
    }
}

[[noreturn]] void fail(const fs::path& path, const std::string& reason) {
    throw DataError(fmt::format("{}: {}", path.string(), reason));
}

/// An open file descriptor.
struct OpenFile {
    explicit OpenFile(const fs::path& path) : fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd < 0) fail(path, fmt::format("cannot be read: {}", std::strerror(errno)));
    }
    OpenFile(const OpenFile&) = delete;
    ~OpenFile() { ::close(fd); }

    const int fd;
};

}  // namespace

std::string input_fault(const fs::path& path) {
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    // status() also reports a missing file as an error.
    if (error) return error.message();
    if (!fs::is_regular_file(status)) return fmt::format("it is {}, not a regular file", kind_word(status.type()));
    const int fd = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) return std::strerror(errno);
    ::close(fd);
    return {};
}

std::ifstream open_input(const fs::path& path, bool is_noted) {
    if (const std::string fault = input_fault(path); !fault.empty()) fail(path, "cannot be read: " + fault);
    std::ifstream in(path, std::ios::binary);
    if (!in) fail(path, fmt::format("cannot be read: {}", std::strerror(errno)));
    if (is_noted) log_debug("reading {}", path.string());
    return in;
}

std::string read_input(const fs::path& path) {
    if (const std::string fault = input_fault(path); !fault.empty()) fail(path, "cannot be read: " + fault);
    const OpenFile file(path);
    log_debug("reading {}", path.string());
    struct stat status = {};
    if (::fstat(file.fd, &status) != 0) fail(path, fmt::format("cannot be read: {}", std::strerror(errno)));
    // Reads to the end of the file, because the stated size may be wrong: it is 0 for all files of /proc.
    const std::size_t stated = std::size_t(status.st_size);
    std::string data(stated + 1, '\0');
    std::size_t have = 0;
    for (ssize_t got = 1; got != 0;) {
        if (have == data.size()) data.resize(have + (std::size_t(1) << 16));
        got = ::read(file.fd, data.data() + have, data.size() - have);
        if (got > 0) have += std::size_t(got);
        if (got < 0 && errno != EINTR)
            fail(path, fmt::format("cannot be read: {} (at byte {})", std::strerror(errno), have));
    }
    if (have < stated) fail(path, fmt::format("cannot be read: only {} of {} bytes came", have, stated));
    data.resize(have);
    return data;
}

std::string read_input_text(const fs::path& path) {
    constexpr std::string_view kMark = "\xef\xbb\xbf", kLittleEndian = "\xff\xfe", kBigEndian = "\xfe\xff";
    std::string text = read_input(path);
    if (text.starts_with(kLittleEndian) || text.starts_with(kBigEndian))
        fail(path, "is a text in UTF-16 (\"Unicode\" in some editors): save it as UTF-8");
    if (text.starts_with(kMark)) text.erase(0, kMark.size());
    return text;
}

bool path_exists(const fs::path& path) {
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (status.type() == fs::file_type::not_found) return false;
    if (error) fail(path, error.message());
    return true;
}

bool folder_exists(const fs::path& path) {
    std::error_code ignored;
    return path_exists(path) && fs::is_directory(path, ignored);
}

std::vector<fs::path> list_folder(const fs::path& folder) {
    std::vector<fs::path> entries;
    std::error_code error;
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
        entries.push_back(it->path());
    if (error) fail(folder, "cannot be listed: " + error.message());
    std::sort(entries.begin(), entries.end());
    return entries;
}

fs::path canonical_path(const fs::path& path) {
    std::error_code error;
    fs::path canonical = fs::weakly_canonical(path, error);
    if (error) fail(path, error.message());
    return canonical;
}

}  // namespace gs
