// SPDX-License-Identifier: Apache-2.0
// Reads the vertices of PLY files in any of the three formats, and writes the header of binary little-endian PLY files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iosfwd>
#include <optional>
#include <string>
#include <string_view>
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
    /// Number of floats in the element `shared` after the vertices; 0 = no such element
    std::int64_t num_shared = 0;
};

/// Writes the header of a binary little-endian file; the caller then writes `count` packed rows and `num_shared`
/// floats.
void write_ply_header(std::ostream& out, const PlyHeader& header);

/// Reads the vertices of a PLY in chunks, so that memory does not grow with the file. Supports text and both byte
/// orders, and scalar properties of any type. List properties and other elements (faces, cameras), before or after the
/// vertices, are skipped; the element `shared` is read only directly after the vertices. Trailing bytes are ignored.
/// Errors: DataError naming file and property for a header that is not PLY, for duplicate names, and for a file shorter
/// than its header declares (checked before any allocation). `next_chunk` throws one for a row that does not consist of
/// numbers.
class PlyReader {
  public:
    explicit PlyReader(const std::filesystem::path& path);

    const PlyHeader& header() const { return header_; }
    /// Returns the index of the property, or -1.
    int find(const std::string& name) const;
    /// Returns the index of the property. Throws DataError naming file and property if it is missing.
    int require(const std::string& name) const;

    /// Reads the next rows into the buffer. Returns the number of rows, 0 at the end.
    std::int64_t next_chunk();
    /// Returns the values of the element `shared`. Call it after the last chunk.
    std::vector<float> read_shared();
    /// Returns a property in row `row` of the current chunk, converted to double.
    double value(std::int64_t row, int property) const;

    /// Throws DataError "cannot read 'file': reason".
    [[noreturn]] void fail(const std::string& reason) const;

  private:
    enum class Format { kText, kLittleEndian, kBigEndian };
    struct Property {
        std::optional<PlyType> type;        ///< type of the value, or of a list's values
        std::optional<PlyType> count_type;  ///< type of a list's length; empty for a scalar
    };
    struct Element {
        std::string name;
        std::int64_t count = 0;
        std::vector<Property> properties;
    };

    std::string header_line();
    void parse_header();
    void parse_property(const std::string& line, Element& element);
    std::int64_t remaining();
    /// Returns the smallest possible size of a row in bytes.
    std::int64_t least_row_bytes(const Element& element) const;
    void check_fits(const Element& element);
    void skip(const Element& element);
    /// Finds the next row of a text file that is not blank. Returns false at the end of the file.
    bool next_text_row();
    /// Reads the scalars of a row into `values`, unless it is null. Returns false at the end of the file.
    bool read_text_row(std::int64_t row, double* values);
    bool read_row(const Element& element, double* values);
    bool read_number(PlyType type, double& value);
    void swap_bytes(std::int64_t rows);

    std::filesystem::path path_;
    std::ifstream in_;
    std::int64_t file_bytes_ = 0;
    Format format_ = Format::kLittleEndian;
    std::vector<Element> before_;  ///< the elements before the vertices
    Element vertices_;
    PlyHeader header_;
    /// Whether chunk_ holds the rows in the file's layout (but little endian); otherwise values_ holds them.
    bool packed_ = true;
    std::vector<std::int64_t> offsets_;  ///< byte offset of each property in a packed row
    std::int64_t row_bytes_ = 0, rows_read_ = 0;
    std::vector<char> chunk_, row_buffer_;
    std::vector<double> values_;
    std::string_view text_row_;
};

}  // namespace gs
