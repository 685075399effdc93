// SPDX-License-Identifier: Apache-2.0
// Writes the event files that TensorBoard shows: TFRecords of Event messages (protocol buffers).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Returns the CRC-32C of the bytes: polynomial 0x1EDC6F41, reflected, begun with and inverted by all ones, as RFC 3720
/// (appendix B.4) has it with test vectors.
std::uint32_t crc32c(std::string_view bytes);

/// A new event file that grows record by record, readable while it does.
class EventFile {
  public:
    /// One number by its name. TensorBoard groups names by what stands before the slash.
    struct Scalar {
        std::string tag;
        double value = 0;
    };

    /// Creates the folder and a file in it whose name sorts behind those of earlier files. Throws DataError.
    explicit EventFile(const std::filesystem::path& folder);
    /// Removes the file again if nothing was added, and the folder if it was made for it.
    ~EventFile();
    EventFile(const EventFile&) = delete;
    EventFile& operator=(const EventFile&) = delete;

    const std::filesystem::path& path() const { return path_; }

    // Each adds one record, and throws DataError if it cannot be written: the file then ends with the record before.
    void add(std::int64_t step, const std::vector<Scalar>& scalars);
    /// `picture` has 3 channels of 8 bits.
    void add(std::int64_t step, const std::string& tag, const Image& picture);
    /// Tells readers that what earlier files have from `step` on was done anew.
    void restart(std::int64_t step);

  private:
    void create();
    void append(const std::string& event);

    std::filesystem::path folder_, path_;
    bool made_folder_ = false;
    int fd_ = -1;
    std::int64_t size_ = 0, empty_size_ = 0;  ///< bytes of whole records; of those that a new file begins with
};

}  // namespace gs
