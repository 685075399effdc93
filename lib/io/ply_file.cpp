// SPDX-License-Identifier: Apache-2.0
// Writes PLY headers; reads PLY headers and packed rows.
#include "lib/io/ply_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <ostream>
#include <sstream>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little, "rows are written as they lie in memory");

struct TypeName {
    const char* name;
    const char* alias;  ///< the sized spelling that some writers use
    int bytes;
};
constexpr std::array<TypeName, 8> kTypes = {{{"char", "int8", 1},
                                             {"uchar", "uint8", 1},
                                             {"short", "int16", 2},
                                             {"ushort", "uint16", 2},
                                             {"int", "int32", 4},
                                             {"uint", "uint32", 4},
                                             {"float", "float32", 4},
                                             {"double", "float64", 8}}};

/// The upper limits of a header: characters per line, properties, lines. Real files have below 200 characters per line
/// and properties.
constexpr std::size_t kMaxLine = 4096, kMaxProperties = 4096, kMaxLines = 16384;

constexpr std::int64_t kChunkBytes = 1 << 22;

template <class T> double load(const char* p) {
    T v;
    std::memcpy(&v, p, sizeof v);
    return double(v);
}

}  // namespace

void write_ply_header(std::ostream& out, const PlyHeader& header) {
    out << "ply\nformat binary_little_endian 1.0\n";
    for (const std::string& c : header.comments) out << "comment " << c << '\n';
    out << "element vertex " << header.count << '\n';
    for (const PlyProperty& p : header.properties)
        out << "property " << kTypes[std::size_t(p.type)].name << ' ' << p.name << '\n';
    if (header.num_shared > 0) out << "element shared " << header.num_shared << "\nproperty float value\n";
    out << "end_header\n";
}

PlyReader::PlyReader(const std::filesystem::path& path) : path_(path) {
    if (const std::string fault = input_fault(path); !fault.empty()) fail(fault);
    std::error_code error;
    const std::int64_t file_bytes = std::int64_t(std::filesystem::file_size(path, error));
    if (error) fail(error.message());
    in_.open(path, std::ios::binary);
    if (!in_) fail(std::strerror(errno));
    parse_header();
    for (const PlyProperty& p : header_.properties) {
        offsets_.push_back(row_bytes_);
        row_bytes_ += kTypes[std::size_t(p.type)].bytes;
    }
    const std::int64_t available = file_bytes - std::int64_t(in_.tellg());
    if (row_bytes_ > 0 && header_.count > available / row_bytes_) {
        fail(fmt::format("'element vertex {}' needs {} bytes each, but only {} bytes follow the header: truncated file",
                         header_.count, row_bytes_, available));
    }
    const std::int64_t behind = available - header_.count * row_bytes_;
    if (header_.num_shared > behind / std::int64_t(sizeof(float)))
        fail(
            fmt::format("'element shared {}' needs 4 bytes each, but only {} bytes follow the vertices: truncated file",
                        header_.num_shared, behind));
}

void PlyReader::parse_header() {
    std::string line;
    const auto next_line = [&] {
        line.clear();
        for (char c; in_.get(c) && c != '\n';) {
            if (line.size() >= kMaxLine) fail("a header line is too long: not a PLY file");
            line += c;
        }
        if (!in_) fail("the header has no 'end_header': truncated, or not a PLY file");
        if (!line.empty() && line.back() == '\r') line.pop_back();
    };
    next_line();
    if (line != "ply") fail("the first line is not 'ply'");
    bool have_format = false, in_vertex = false, have_vertex = false, in_shared = false, more = false;
    for (std::size_t lines = 0;; ++lines) {
        if (lines > kMaxLines) fail("the header has too many lines");
        next_line();
        std::istringstream words(line);
        std::string word;
        words >> word;
        if (word == "end_header") break;
        if (word == "comment") {
            header_.comments.push_back(line.size() > 8 ? line.substr(8) : "");
        } else if (word == "format") {
            std::string format;
            words >> format;
            if (format != "binary_little_endian")
                fail(fmt::format("format '{}' is not supported; convert it to binary_little_endian", format));
            have_format = true;
        } else if (word == "element") {
            std::string name;
            in_vertex = bool(words >> name) && name == "vertex" && !have_vertex;
            in_shared = have_vertex && !more && name == "shared";
            more = more || have_vertex;
            if (in_shared) {
                if (!(words >> header_.num_shared) || header_.num_shared < 0 || words >> word)
                    fail(fmt::format("bad count in '{}'", line));
            } else if (in_vertex) {
                if (!(words >> header_.count) || header_.count < 0 || words >> word)
                    fail(fmt::format("bad vertex count in '{}'", line));
                have_vertex = true;
            } else if (!have_vertex) {
                fail(fmt::format("element '{}' stands before the vertices", name));
            }
        } else if (word == "property" && in_vertex) {
            std::string type, name;
            words >> type >> name;
            const auto it = std::find_if(kTypes.begin(), kTypes.end(),
                                         [&](const TypeName& t) { return type == t.name || type == t.alias; });
            if (it == kTypes.end() || name.empty()) fail(fmt::format("cannot use vertex property '{}'", line));
            if (find(name) >= 0) fail(fmt::format("vertex property '{}' appears twice", name));
            if (header_.properties.size() >= kMaxProperties) fail("too many vertex properties");
            header_.properties.push_back({name, PlyType(it - kTypes.begin())});
        } else if (word == "property" && in_shared) {
            if (line != "property float value")
                fail(fmt::format("element shared: expected 'property float value', found '{}'", line));
        } else if (word != "property" && word != "obj_info") {
            fail(fmt::format("unknown header line '{}'", line));
        }
    }
    if (!have_format) fail("the header has no 'format' line");
    if (!have_vertex || header_.properties.empty()) fail("the header has no vertices");
}

int PlyReader::find(const std::string& name) const {
    for (std::size_t i = 0; i < header_.properties.size(); ++i) {
        if (header_.properties[i].name == name) return int(i);
    }
    return -1;
}

int PlyReader::require(const std::string& name) const {
    const int i = find(name);
    if (i < 0) fail(fmt::format("vertex property '{}' is missing", name));
    return i;
}

std::int64_t PlyReader::next_chunk() {
    const std::int64_t rows = std::min(header_.count - rows_read_, std::max<std::int64_t>(1, kChunkBytes / row_bytes_));
    chunk_.resize(std::size_t(rows * row_bytes_));
    in_.read(chunk_.data(), std::streamsize(chunk_.size()));
    if (!in_) fail(fmt::format("read error after {} of {} vertices", rows_read_, header_.count));
    rows_read_ += rows;
    return rows;
}

std::vector<float> PlyReader::read_shared() {
    std::vector<float> values(std::size_t(header_.num_shared));
    in_.read(reinterpret_cast<char*>(values.data()), std::streamsize(values.size() * sizeof(float)));
    if (!in_) fail("read error in the element shared");
    return values;
}

double PlyReader::value(std::int64_t row, int property) const {
    const char* p = chunk_.data() + row * row_bytes_ + offsets_[std::size_t(property)];
    switch (header_.properties[std::size_t(property)].type) {
        case PlyType::kInt8:
            return load<std::int8_t>(p);
        case PlyType::kUint8:
            return load<std::uint8_t>(p);
        case PlyType::kInt16:
            return load<std::int16_t>(p);
        case PlyType::kUint16:
            return load<std::uint16_t>(p);
        case PlyType::kInt32:
            return load<std::int32_t>(p);
        case PlyType::kUint32:
            return load<std::uint32_t>(p);
        case PlyType::kFloat:
            return load<float>(p);
        case PlyType::kDouble:
            return load<double>(p);
    }
    return 0;
}

void PlyReader::fail(const std::string& reason) const {
    throw DataError(fmt::format("cannot read '{}': {}", path_.string(), reason));
}

}  // namespace gs
