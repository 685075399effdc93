// SPDX-License-Identifier: Apache-2.0
// Encodes the few messages that TensorBoard needs. Field numbers are from TensorFlow's event.proto and summary.proto,
// and the framing is from its record_writer.
#include "lib/io/event_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>

#include "kernels/base/error.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

constexpr std::uint32_t kReflectedPolynomial = 0x82F63B78;

constexpr std::array<std::uint32_t, 256> make_table() {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t value = byte;
        for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ ((value & 1) != 0 ? kReflectedPolynomial : 0);
        table[byte] = value;
    }
    return table;
}

namespace fs = std::filesystem;

constexpr int kJpegQuality = 95;

template <class T> std::string little_endian(T value) {
    std::string bytes;
    for (std::size_t k = 0; k < sizeof value; ++k) bytes += char((value >> 8 * k) & 255);
    return bytes;
}

/// A protocol buffer message under construction. Fields are numbered as in its definition.
class Message {
  public:
    Message& whole(int field, std::uint64_t value) {
        tag(field, 0), varint(value);
        return *this;
    }
    Message& number(int field, double value) {
        tag(field, 1), bytes_ += little_endian(std::bit_cast<std::uint64_t>(value));
        return *this;
    }
    Message& number(int field, float value) {
        tag(field, 5), bytes_ += little_endian(std::bit_cast<std::uint32_t>(value));
        return *this;
    }
    /// Adds a text, bytes, or another message.
    Message& text(int field, std::string_view value) {
        tag(field, 2), varint(value.size()), bytes_ += value;
        return *this;
    }
    const std::string& bytes() const { return bytes_; }

  private:
    void tag(int field, int kind) { varint(std::uint64_t(field) << 3 | std::uint64_t(kind)); }
    void varint(std::uint64_t value) {
        for (; value >= 128; value >>= 7) bytes_ += char((value & 127) | 128);
        bytes_ += char(value);
    }

    std::string bytes_;
};

double wall_time() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Begins an Event: 1 = wall_time, 2 = step.
Message event(std::int64_t step) { return Message().number(1, wall_time()).whole(2, std::uint64_t(step)); }

/// Returns the masked CRC of TFRecords, which protects checksums of bytes that hold checksums themselves.
std::uint32_t masked_crc(std::string_view bytes) { return std::rotr(crc32c(bytes), 15) + 0xA282EAD8u; }

std::string host_name() {
    char name[256] = "";
    return ::gethostname(name, sizeof name - 1) == 0 && name[0] != 0 ? name : "localhost";
}

}  // namespace

std::uint32_t crc32c(std::string_view bytes) {
    static constexpr std::array<std::uint32_t, 256> kTable = make_table();
    std::uint32_t crc = ~0u;
    for (const char c : bytes) crc = crc >> 8 ^ kTable[(crc ^ std::uint8_t(c)) & 255];
    return ~crc;
}

EventFile::EventFile(const fs::path& folder) : folder_(folder) {
    std::error_code ignored;
    made_folder_ = !fs::exists(folder, ignored);
    create_folders(folder, folder);
    create();
    try {
        append(Message().number(1, wall_time()).text(3, "brain.Event:2").bytes());  // 3 = file_version
    } catch (...) {
        ::close(fd_);
        fs::remove(path_, ignored);
        if (made_folder_) fs::remove(folder_, ignored);
        throw;
    }
    empty_size_ = size_;
}

/// Creates the file, named by the current second. If an earlier run has a file of that name, uses the next free second.
void EventFile::create() {
    for (auto second = std::int64_t(wall_time());; ++second) {
        path_ = folder_ / fmt::format("events.out.tfevents.{:010}.{}.gsapp", second, host_name());
        fd_ = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd_ >= 0) return;
        if (errno != EEXIST) {
            const int error = errno;
            std::error_code ignored;
            if (made_folder_) fs::remove(folder_, ignored);
            fail_to_write("create", path_, error);
        }
    }
}

EventFile::~EventFile() {
    ::close(fd_);
    if (size_ > empty_size_) return;
    std::error_code ignored;
    fs::remove(path_, ignored);
    if (made_folder_) fs::remove(folder_, ignored);  // only if it is empty
}

void EventFile::add(std::int64_t step, const std::vector<Scalar>& scalars) {
    Message summary;  // Summary: 1 = value; Value: 1 = tag, 2 = simple_value
    for (const Scalar& scalar : scalars)
        summary.text(1, Message().text(1, scalar.tag).number(2, float(scalar.value)).bytes());
    append(event(step).text(5, summary.bytes()).bytes());  // 5 = summary
}

void EventFile::add(std::int64_t step, const std::string& tag, const Image& picture) {
    const std::vector<std::uint8_t> jpeg = encode_jpeg(picture, kJpegQuality);
    Message image;  // Image: 1 = height, 2 = width, 3 = colorspace (3: rgb), 4 = encoded_image_string
    image.whole(1, std::uint64_t(picture.height)).whole(2, std::uint64_t(picture.width)).whole(3, 3);
    image.text(4, {reinterpret_cast<const char*>(jpeg.data()), jpeg.size()});
    const std::string value = Message().text(1, tag).text(4, image.bytes()).bytes();  // Value: 4 = image
    append(event(step).text(5, Message().text(1, value).bytes()).bytes());
}

void EventFile::restart(std::int64_t step) {
    append(event(step).text(7, Message().whole(1, 1).bytes()).bytes());  // 7 = session_log, with status START
}

void EventFile::append(const std::string& data) {
    const std::string length = little_endian(std::uint64_t(data.size()));
    const std::string record = length + little_endian(masked_crc(length)) + data + little_endian(masked_crc(data));
    for (std::size_t done = 0; done < record.size();) {
        const ssize_t written = ::write(fd_, record.data() + done, record.size() - done);
        if (written >= 0) {
            done += std::size_t(written);
        } else if (errno != EINTR) {
            const int error = errno;
            if (::ftruncate(fd_, size_) != 0) {  // readers could not read records after a partial one
                ::close(fd_);
                fd_ = -1;
            }
            throw DataError(fmt::format("cannot write '{}': {}", path_.string(), std::strerror(error)));
        }
    }
    size_ += std::int64_t(record.size());
}

}  // namespace gs
