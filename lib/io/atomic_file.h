// SPDX-License-Identifier: Apache-2.0
// Writes files that appear complete or not at all: under a temporary name in the same folder, then renamed.
#pragma once

#include <filesystem>
#include <memory>
#include <ostream>
#include <string_view>

namespace gs {

/// A file under construction. Missing parent folders are created. The target is untouched until `commit`; without
/// `commit` the destructor removes the temporary file. Leftovers of a killed program are removed by the next program
/// that writes into the folder (lib/io/temporary.h).
/// Errors: every failure (folder not writable, disk full, file too large) throws DataError naming the path and the
/// system's reason, either from the write that failed or from `commit`.
class AtomicFile {
  public:
    explicit AtomicFile(std::filesystem::path path);
    ~AtomicFile();
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    /// Returns the binary stream. It is buffered, so small writes are cheap.
    std::ostream& stream();
    /// Flushes to the disk (fsync), renames over the target, and flushes the folder. Nothing may be written afterwards.
    void commit();

  private:
    class Buffer;
    std::filesystem::path path_;
    std::unique_ptr<Buffer> buffer_;
    std::ostream stream_;
};

/// Copies a file through an AtomicFile. Throws DataError.
void copy_file_atomic(const std::filesystem::path& from, const std::filesystem::path& to);

/// Writes `text` to `path` through an AtomicFile. Throws DataError.
void write_text_atomic(const std::filesystem::path& path, std::string_view text);

}  // namespace gs
