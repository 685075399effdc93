// SPDX-License-Identifier: Apache-2.0
// Implements AtomicFile with a stream buffer over a file descriptor, because iostreams neither report errno nor offer
// fsync.
#include "lib/io/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <streambuf>
#include <string>
#include <vector>

#include "kernels/core/error.h"

namespace gs {
namespace {

[[noreturn]] void fail(const char* action, const std::filesystem::path& path, int error) {
    const char* hint = error == ENOSPC || error == EDQUOT ? "; free some space and run again"
                       : error == EACCES || error == EROFS || error == EPERM
                           ? "; choose an output folder you may write to"
                           : "";
    throw DataError(fmt::format("cannot {} '{}': {}{}", action, path.string(), std::strerror(error), hint));
}

/// Returns a temporary name in the target's folder, so that the rename stays within one file system. The name is
/// hidden, so that folder scans ignore it.
std::filesystem::path temporary_name(const std::filesystem::path& path) {
    static std::atomic<unsigned> counter{0};
    return path.parent_path() / fmt::format(".{}.{}-{}.tmp", path.filename().string(), ::getpid(), counter++);
}

/// Makes the rename survive a power cut. Not every file system can sync a folder; the content is safe either way.
void sync_folder(const std::filesystem::path& folder) {
    const int fd = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return;
    ::fsync(fd);
    ::close(fd);
}

}  // namespace

class AtomicFile::Buffer : public std::streambuf {
  public:
    explicit Buffer(const std::filesystem::path& target) : target_(target), bytes_(1 << 18) {
        do {
            temporary_ = temporary_name(target);
            fd_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        } while (fd_ < 0 && errno == EEXIST);
        if (fd_ < 0) fail("create", target_, errno);
        setp(bytes_.data(), bytes_.data() + bytes_.size());
    }

    ~Buffer() override {
        if (fd_ >= 0) ::close(fd_);
        if (!renamed_) ::unlink(temporary_.c_str());
    }

    void commit() {
        drain();
        // Pipes and some network file systems cannot sync (EINVAL). The file is kept nevertheless.
        if (::fsync(fd_) != 0 && errno != EINVAL && errno != ENOTSUP) fail("write", target_, errno);
        const int closed = ::close(fd_);
        fd_ = -1;
        if (closed != 0) fail("write", target_, errno);
        if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail("replace", target_, errno);
        renamed_ = true;
        sync_folder(target_.parent_path());
    }

  protected:
    int_type overflow(int_type c) override {
        drain();
        if (!traits_type::eq_int_type(c, traits_type::eof())) sputc(traits_type::to_char_type(c));
        return traits_type::not_eof(c);
    }

    std::streamsize xsputn(const char* data, std::streamsize size) override {
        if (size == 0) return 0;  // an empty vector's pointer is null, and memcpy does not accept null
        if (size <= epptr() - pptr()) {
            std::memcpy(pptr(), data, std::size_t(size));
            pbump(int(size));
        } else {
            drain();
            write_all(data, std::size_t(size));
        }
        return size;
    }

    int sync() override {
        drain();
        return 0;
    }

  private:
    void drain() {
        const std::size_t size = std::size_t(pptr() - pbase());
        setp(bytes_.data(), bytes_.data() + bytes_.size());
        write_all(bytes_.data(), size);
    }

    void write_all(const char* data, std::size_t size) {
        while (size > 0) {
            const ssize_t written = ::write(fd_, data, size);
            if (written < 0 && errno == EINTR) continue;
            if (written < 0) fail("write", target_, errno);
            data += written;
            size -= std::size_t(written);
        }
    }

    std::filesystem::path target_, temporary_;
    std::vector<char> bytes_;
    int fd_ = -1;
    bool renamed_ = false;
};

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)), stream_(nullptr) {
    std::error_code error;
    if (path_.has_parent_path()) std::filesystem::create_directories(path_.parent_path(), error);
    if (error) fail("create the folder of", path_, error.value());
    buffer_ = std::make_unique<Buffer>(path_);
    stream_.rdbuf(buffer_.get());
    // With badbit enabled, the stream passes on the DataError that the buffer throws.
    stream_.exceptions(std::ios::badbit);
}

AtomicFile::~AtomicFile() = default;

std::ostream& AtomicFile::stream() { return stream_; }

void AtomicFile::commit() { buffer_->commit(); }

void write_text_atomic(const std::filesystem::path& path, std::string_view text) {
    AtomicFile file(path);
    file.stream().write(text.data(), std::streamsize(text.size()));
    file.commit();
}

}  // namespace gs
