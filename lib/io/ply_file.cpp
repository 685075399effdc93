// SPDX-License-Identifier: Apache-2.0
// Writes PLY headers; reads PLY headers and rows in all three formats.
#include "lib/io/ply_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <ostream>
#include <sstream>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"

namespace gs {
namespace {

static_assert(std::endian::native == std::endian::little, "little-endian rows are read and written as in memory");

struct TypeName {
    const char* name;
    const char* alias;  ///< sized type name that some writers use
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

/// Upper limits of a header: characters per line, properties, lines. Real files have fewer than 200 characters per line
/// and fewer than 200 properties.
constexpr std::size_t kMaxLine = 4096, kMaxProperties = 4096, kMaxLines = 16384;

constexpr std::int64_t kChunkBytes = 1 << 22;

/// The upper limit of one row of a text file, characters: enough for kMaxProperties numbers of 250.
constexpr std::size_t kMaxTextRow = std::size_t(1) << 20;

constexpr std::string_view kBlanks = " \t\r\v\f";

int bytes_of(PlyType type) { return kTypes[std::size_t(type)].bytes; }

std::optional<PlyType> type_named(const std::string& word) {
    const auto it = std::find_if(kTypes.begin(), kTypes.end(),
                                 [&](const TypeName& t) { return word == t.name || word == t.alias; });
    if (it == kTypes.end()) return {};
    return PlyType(it - kTypes.begin());
}

template <class T> double load_as(const char* p) {
    T v;
    std::memcpy(&v, p, sizeof v);
    return double(v);
}

double load(const char* p, PlyType type) {
    switch (type) {
        case PlyType::kInt8:
            return load_as<std::int8_t>(p);
        case PlyType::kUint8:
            return load_as<std::uint8_t>(p);
        case PlyType::kInt16:
            return load_as<std::int16_t>(p);
        case PlyType::kUint16:
            return load_as<std::uint16_t>(p);
        case PlyType::kInt32:
            return load_as<std::int32_t>(p);
        case PlyType::kUint32:
            return load_as<std::uint32_t>(p);
        case PlyType::kFloat:
            return load_as<float>(p);
        case PlyType::kDouble:
            return load_as<double>(p);
    }
    return 0;
}

/// Parses a number independently of the locale. Returns nothing if the text is not a number. "1.#QNAN" and "1.#INF" of
/// older Windows programs are read as non-finite numbers.
std::optional<double> parse_number(std::string_view text) {
    if (text.find('#') != std::string_view::npos) return std::numeric_limits<double>::quiet_NaN();
    if (text.starts_with('+')) text.remove_prefix(1);
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (end != text.data() + text.size() || error == std::errc::invalid_argument) return {};
    if (error == std::errc::result_out_of_range) return std::strtod(std::string(text).c_str(), nullptr);
    return value;
}

/// Removes and returns the first word of `text`, or returns an empty word at its end.
std::string_view take_word(std::string_view& text) {
    text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
    const std::string_view word = text.substr(0, text.find_first_of(kBlanks));
    text.remove_prefix(word.size());
    return word;
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
    file_bytes_ = std::int64_t(std::filesystem::file_size(path, error));
    if (error) fail(error.message());
    in_.open(path, std::ios::binary);
    if (!in_) fail(std::strerror(errno));
    parse_header();
    for (const Element& element : before_) skip(element);
    check_fits(vertices_);
    const bool has_list = std::any_of(vertices_.properties.begin(), vertices_.properties.end(),
                                      [](const Property& p) { return p.count_type.has_value(); });
    packed_ = format_ != Format::kText && !has_list;
    for (const PlyProperty& p : header_.properties) {
        offsets_.push_back(row_bytes_);
        row_bytes_ += packed_ ? bytes_of(p.type) : int(sizeof(double));
    }
    const std::int64_t behind = remaining() - header_.count * least_row_bytes(vertices_);
    const bool text = format_ == Format::kText;
    const std::int64_t each = text ? 2 : std::int64_t(sizeof(float));
    if (header_.num_shared > (behind + text) / each)
        fail(fmt::format(
            "'element shared {}' needs {} bytes each, but only {} bytes follow the vertices: truncated file",
            header_.num_shared, each, behind));
}

std::string PlyReader::header_line() {
    std::string line;
    for (char c; in_.get(c) && c != '\n';) {
        if (line.size() >= kMaxLine) fail("a header line is too long: not a PLY file");
        line += c;
    }
    if (!in_) fail("the header has no 'end_header': truncated, or not a PLY file");
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return line;
}

void PlyReader::parse_header() {
    if (header_line() != "ply") fail("the first line is not 'ply'");
    bool have_format = false, have_vertex = false;
    Element* element = nullptr;  // element whose properties are parsed; null for elements that are never read
    bool in_shared = false, more = false;
    for (std::size_t lines = 0;; ++lines) {
        if (lines > kMaxLines) fail("the header has too many lines");
        const std::string line = header_line();
        std::istringstream words(line);
        std::string word;
        words >> word;
        if (word == "end_header") break;
        if (word == "comment") {
            header_.comments.push_back(line.size() > 8 ? line.substr(8) : "");
        } else if (word == "format") {
            std::string format;
            words >> format;
            if (format == "ascii")
                format_ = Format::kText;
            else if (format == "binary_little_endian")
                format_ = Format::kLittleEndian;
            else if (format == "binary_big_endian")
                format_ = Format::kBigEndian;
            else
                fail(
                    fmt::format("format '{}' is not one of ascii, binary_little_endian and binary_big_endian", format));
            have_format = true;
        } else if (word == "element") {
            Element found;
            words >> found.name;
            in_shared = have_vertex && !more && found.name == "shared";
            more = more || have_vertex;
            element = nullptr;
            if (have_vertex && !in_shared) continue;
            if (!(words >> found.count) || found.count < 0 || words >> word)
                fail(fmt::format("bad {} count in '{}'", found.name, line));
            if (in_shared) {
                header_.num_shared = found.count;
            } else if (found.name == "vertex") {
                have_vertex = true;
                header_.count = found.count;
                vertices_ = std::move(found);
                element = &vertices_;
            } else {
                element = &before_.emplace_back(std::move(found));
            }
        } else if (word == "property" && in_shared) {
            if (line != "property float value")
                fail(fmt::format("element shared: expected 'property float value', found '{}'", line));
        } else if (word == "property" && element) {
            parse_property(line, *element);
        } else if (word != "property" && word != "obj_info" && !word.empty()) {
            fail(fmt::format("unknown header line '{}'", line));
        }
    }
    if (!have_format) fail("the header has no 'format' line");
    if (!have_vertex || header_.properties.empty()) fail("the header has no vertices");
}

void PlyReader::parse_property(const std::string& line, Element& element) {
    std::istringstream words(line);
    std::string word, type, count_type, name;
    words >> word >> type;
    const bool is_list = type == "list";
    if (is_list) words >> count_type >> type;
    words >> name;
    Property property{type_named(type), {}};
    if (is_list) property.count_type = type_named(count_type);
    if (name.empty() || !property.type || (is_list && !property.count_type))
        fail(fmt::format("cannot use {} property '{}'", element.name, line));
    if (element.properties.size() >= kMaxProperties) fail(fmt::format("too many {} properties", element.name));
    if (&element == &vertices_ && !is_list) {
        if (find(name) >= 0) fail(fmt::format("vertex property '{}' appears twice", name));
        header_.properties.push_back({name, *property.type});
    }
    element.properties.push_back(property);
}

std::int64_t PlyReader::least_row_bytes(const Element& element) const {
    std::int64_t bytes = 0;
    for (const Property& p : element.properties)
        // In text every number has at least a digit and a separator; in an empty list this number is the length.
        bytes += format_ == Format::kText ? 2 : bytes_of(p.count_type.value_or(*p.type));
    return bytes;
}

std::int64_t PlyReader::remaining() { return file_bytes_ - std::int64_t(in_.tellg()); }

void PlyReader::check_fits(const Element& element) {
    const std::int64_t each = least_row_bytes(element), bytes = remaining();
    // A text file may end without a final separator.
    if (each > 0 && element.count > (bytes + (format_ == Format::kText)) / each)
        fail(fmt::format("'element {} {}' needs {} bytes each, but only {} bytes are left: truncated file",
                         element.name, element.count, each, bytes));
}

void PlyReader::skip(const Element& element) {
    check_fits(element);
    if (element.properties.empty()) return;
    for (std::int64_t row = 0; row < element.count; ++row)
        if (!(format_ == Format::kText ? next_text_row() : read_row(element, nullptr)))
            fail(fmt::format("it ends within the element {}: truncated file", element.name));
}

bool PlyReader::next_text_row() {
    row_buffer_.resize(kMaxTextRow);
    do {
        in_.getline(row_buffer_.data(), std::streamsize(row_buffer_.size()));
        if (in_.gcount() + 1 == std::streamsize(row_buffer_.size()))
            fail(fmt::format("a row is longer than {} characters", kMaxTextRow));
        if (in_.fail()) return false;
        text_row_ = row_buffer_.data();
    } while (text_row_.find_first_not_of(kBlanks) == std::string_view::npos);
    return true;
}

bool PlyReader::read_number(PlyType type, double& value) {
    char bytes[8];
    if (!in_.read(bytes, bytes_of(type))) return false;
    if (format_ == Format::kBigEndian) std::reverse(bytes, bytes + bytes_of(type));
    value = load(bytes, type);
    return true;
}

bool PlyReader::read_row(const Element& element, double* values) {
    for (const Property& property : element.properties) {
        double value = 0;
        if (!read_number(property.count_type.value_or(*property.type), value)) return false;
        if (!property.count_type) {
            if (values) *values++ = value;
            continue;
        }
        if (!(value >= 0 && value <= double(file_bytes_)))
            fail(fmt::format("element {}: a list has the length {}", element.name, value));
        const std::int64_t bytes = std::int64_t(value) * bytes_of(*property.type);
        in_.ignore(bytes);
        if (in_.gcount() != bytes) return false;
    }
    return true;
}

bool PlyReader::read_text_row(std::int64_t row, double* values) {
    if (!next_text_row()) return false;
    std::string_view rest = text_row_;
    const auto next = [&] {
        const std::string_view word = take_word(rest);
        if (word.empty())
            fail(fmt::format("vertex {} has fewer numbers than the header says: '{}'", row, text_row_.substr(0, 80)));
        const std::optional<double> value = parse_number(word);
        if (!value) fail(fmt::format("vertex {}: '{}' is not a number", row, word.substr(0, 40)));
        return *value;
    };
    for (const Property& property : vertices_.properties) {
        const double value = next();
        if (!property.count_type) {
            *values++ = value;
            continue;
        }
        if (!(value >= 0)) fail(fmt::format("vertex {}: a list has the length {}", row, value));
        for (double i = 0; i < value; ++i) next();
    }
    if (!take_word(rest).empty())
        fail(fmt::format("vertex {} has more numbers than the header says: '{}'", row, text_row_.substr(0, 80)));
    return true;
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
    const auto cut_off = [&](std::int64_t row) {
        fail(fmt::format("read error after {} of {} vertices", rows_read_ + row, header_.count));
    };
    if (packed_) {
        chunk_.resize(std::size_t(rows * row_bytes_));
        if (!in_.read(chunk_.data(), std::streamsize(chunk_.size()))) cut_off(0);
        if (format_ == Format::kBigEndian) swap_bytes(rows);
    } else {
        values_.resize(std::size_t(rows) * header_.properties.size());
        for (std::int64_t r = 0; r < rows; ++r) {
            double* row = values_.data() + std::size_t(r) * header_.properties.size();
            if (!(format_ == Format::kText ? read_text_row(rows_read_ + r, row) : read_row(vertices_, row))) cut_off(r);
        }
    }
    rows_read_ += rows;
    return rows;
}

void PlyReader::swap_bytes(std::int64_t rows) {
    for (std::int64_t r = 0; r < rows; ++r)
        for (std::size_t k = 0; k < offsets_.size(); ++k) {
            char* first = chunk_.data() + r * row_bytes_ + offsets_[k];
            std::reverse(first, first + bytes_of(header_.properties[k].type));
        }
}

std::vector<float> PlyReader::read_shared() {
    std::vector<float> values;
    values.reserve(std::size_t(header_.num_shared));
    while (std::int64_t(values.size()) < header_.num_shared) {
        double value = 0;
        if (format_ == Format::kText) {
            std::string_view row;
            if (next_text_row()) row = text_row_;
            const std::optional<double> number = parse_number(take_word(row));
            if (!number) fail("read error in the element shared");
            value = *number;
        } else if (!read_number(PlyType::kFloat, value)) {
            fail("read error in the element shared");
        }
        values.push_back(float(value));
    }
    return values;
}

double PlyReader::value(std::int64_t row, int property) const {
    const std::size_t k = std::size_t(property);
    if (!packed_) return values_[std::size_t(row) * header_.properties.size() + k];
    return load(chunk_.data() + row * row_bytes_ + offsets_[k], header_.properties[k].type);
}

void PlyReader::fail(const std::string& reason) const {
    throw DataError(fmt::format("cannot read '{}': {}", path_.string(), reason));
}

}  // namespace gs
