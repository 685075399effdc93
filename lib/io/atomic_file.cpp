// SPDX-License-Identifier: Apache-2.0
// Implements AtomicFile with a stream buffer over a file descriptor, because iostreams neither report errno nor offer
// fsync.
#include "lib/io/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <streambuf>
#include <string>
#include <vector>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/io/temporary.h"

namespace gs {

class AtomicFile::Buffer : public std::streambuf {
  public:
    explicit Buffer(const std::filesystem::path& target) : target_(target), bytes_(1 << 18) {
        const TemporaryFile made = create_temporary_file(target);
        temporary_ = made.path;
        fd_ = made.fd;
        setp(bytes_.data(), bytes_.data() + bytes_.size());
    }

    ~Buffer() override {
        if (fd_ >= 0) ::close(fd_);
        if (!renamed_) ::unlink(temporary_.c_str());
    }

    void commit() {
        drain();
        // Some network file systems cannot sync (EINVAL). The file is still kept.
        if (::fsync(fd_) != 0 && errno != EINVAL && errno != ENOTSUP) fail_to_write("write", target_, errno);
        // Closing the first of two descriptors reports write errors. The second descriptor keeps the lock until the
        // rename, so that no other program removes the file as a leftover.
        const int lock = ::fcntl(fd_, F_DUPFD_CLOEXEC, 0), closed = ::close(fd_);
        fd_ = lock;
        if (closed != 0) fail_to_write("write", target_, errno);
        if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail_to_write("replace", target_, errno);
        renamed_ = true;
        ::close(fd_);
        fd_ = -1;
        sync_folder(target_.parent_path(), target_);
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
            if (written < 0) fail_to_write("write", target_, errno);
            data += written;
            size -= std::size_t(written);
        }
        // Starts writing to disk in the background, so that fsync has less to wait for. This is a hint and may fail.
        ::sync_file_range(fd_, 0, 0, SYNC_FILE_RANGE_WRITE);
    }

    std::filesystem::path target_, temporary_;
    std::vector<char> bytes_;
    int fd_ = -1;
    bool renamed_ = false;
};

AtomicFile::AtomicFile(std::filesystem::path path)
    : path_(std::move(path)), buffer_(std::make_unique<Buffer>(path_)), stream_(buffer_.get()) {
    // With badbit enabled, the stream passes on the DataError that the buffer throws.
    stream_.exceptions(std::ios::badbit);
}

AtomicFile::~AtomicFile() = default;

std::ostream& AtomicFile::stream() { return stream_; }

void AtomicFile::commit() { buffer_->commit(); }

void copy_file_atomic(const std::filesystem::path& from, const std::filesystem::path& to) {
    std::ifstream in = open_input(from);
    AtomicFile out(to);
    for (std::vector<char> part(1 << 18); in.read(part.data(), std::streamsize(part.size())), in.gcount() > 0;)
        out.stream().write(part.data(), in.gcount());
    if (in.bad()) throw DataError(fmt::format("cannot read '{}'", from.string()));
    out.commit();
}

void write_text_atomic(const std::filesystem::path& path, std::string_view text) {
    AtomicFile file(path);
    file.stream().write(text.data(), std::streamsize(text.size()));
    file.commit();
}

}  // namespace gs
