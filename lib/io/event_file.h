// SPDX-License-Identifier: Apache-2.0
// Writes event files for TensorBoard: TFRecords of Event messages (protocol buffers).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Returns the CRC-32C of the bytes: polynomial 0x1EDC6F41, reflected, initial value and final XOR all ones. RFC 3720
/// (appendix B.4) has test vectors.
std::uint32_t crc32c(std::string_view bytes);

/// A new event file that grows record by record and is readable at any time.
class EventFile {
  public:
    /// One named number. TensorBoard groups tags by the part before the slash.
    struct Scalar {
        std::string tag;
        double value = 0;
    };

    /// Creates the folder and a file in it whose name sorts after the names of earlier files. Throws DataError.
    explicit EventFile(const std::filesystem::path& folder);
    /// Removes the file if nothing was added, and also the folder if it was created for the file.
    ~EventFile();
    EventFile(const EventFile&) = delete;
    EventFile& operator=(const EventFile&) = delete;

    const std::filesystem::path& path() const { return path_; }

    // Each function adds one record. It throws DataError if the record cannot be written; the file then ends with the
    // previous record.
    void add(std::int64_t step, const std::vector<Scalar>& scalars);
    /// `picture` has 3 channels of 8 bits.
    void add(std::int64_t step, const std::string& tag, const Image& picture);
    /// Marks the records of earlier files from `step` on as superseded.
    void restart(std::int64_t step);

  private:
    void create();
    void append(const std::string& event);

    std::filesystem::path folder_, path_;
    bool made_folder_ = false;
    int fd_ = -1;
    std::int64_t size_ = 0, empty_size_ = 0;  ///< bytes of whole records; bytes of a new file's initial records
};

}  // namespace gs
