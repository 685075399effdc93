// SPDX-License-Identifier: Apache-2.0
// Reads and writes the PLY container that Gaussian-splatting and point-cloud files use: binary little endian, with the
// element `vertex` first.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iosfwd>
#include <string>
#include <vector>

namespace gs {

enum class PlyType : int { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct PlyProperty {
    std::string name;
    PlyType type = PlyType::kFloat;
};

struct PlyHeader {
    std::vector<std::string> comments;  ///< without the word "comment"
    std::int64_t count = 0;             ///< number of vertices
    std::vector<PlyProperty> properties;
    /// The number of floats in the element `shared` after the vertices; 0 = there is no such element
    std::int64_t num_shared = 0;
};

/// Writes the header; the caller then writes `count` packed rows and `num_shared` floats.
void write_ply_header(std::ostream& out, const PlyHeader& header);

/// Reads the vertices of a PLY in chunks, so that memory does not grow with the file. The element `shared` is read only
/// directly after the vertices; other later data (faces, trailing bytes) are ignored.
/// Errors: DataError naming file and property for a header that is not PLY, ASCII or big-endian data, list properties
/// of a vertex, duplicate names, and a file shorter than its header promises (checked before anything is allocated).
class PlyReader {
  public:
    explicit PlyReader(const std::filesystem::path& path);

    const PlyHeader& header() const { return header_; }
    /// Returns the index of the property, or -1.
    int find(const std::string& name) const;
    /// Returns the index of the property. Throws DataError naming file and property when it is missing.
    int require(const std::string& name) const;

    /// Reads the next rows into the buffer. Returns their number, 0 at the end.
    std::int64_t next_chunk();
    /// Returns the values of the element `shared`. Call it after the last chunk.
    std::vector<float> read_shared();
    /// Returns a property in row `row` of the current chunk, converted to double.
    double value(std::int64_t row, int property) const;

    /// Throws DataError "cannot read 'file': reason".
    [[noreturn]] void fail(const std::string& reason) const;

  private:
    void parse_header();

    std::filesystem::path path_;
    std::ifstream in_;
    PlyHeader header_;
    std::vector<std::int64_t> offsets_;  ///< byte offset of each property in a row
    std::int64_t row_bytes_ = 0, rows_read_ = 0;
    std::vector<char> chunk_;
};

}  // namespace gs
