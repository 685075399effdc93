// SPDX-License-Identifier: Apache-2.0
// Reads COLMAP models in text format.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/colmap_checks.h"

namespace gs::colmap {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t\r";

bool is_blank(std::string_view line) { return line.find_first_not_of(kBlanks) == std::string_view::npos; }

bool is_comment(std::string_view line) {
    const std::size_t begin = line.find_first_not_of(kBlanks);
    return begin != std::string_view::npos && line[begin] == '#';
}

/// Parses a field as a number, independently of the locale. Returns nothing if it is not a number.
template <class T> std::optional<T> parse_number(std::string_view text) {
    if (text.starts_with('+')) text.remove_prefix(1);
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size()) return {};
    return value;
}

/// Iterates over the lines of a text file.
class Lines {
  public:
    explicit Lines(const fs::path& file) : file_(file), data_(read_input_text(file)) {}

    /// Reads the next line, including blank lines and comments; returns false at the end.
    bool next_raw(std::string_view& line) {
        if (position_ >= data_.size()) return false;
        const std::size_t end = std::min(data_.find('\n', position_), data_.size());
        line = std::string_view(data_).substr(position_, end - position_);
        last_ = position_;
        position_ = end + 1;
        ++number_;
        return true;
    }

    /// Reads the next line that is neither blank nor a comment; returns false at the end.
    bool next(std::string_view& line) {
        while (next_raw(line))
            if (!is_blank(line) && !is_comment(line)) return true;
        return false;
    }

    /// Puts the last line back, so that it is read again.
    void put_back() { position_ = last_, --number_; }

    const fs::path& file() const { return file_; }
    std::size_t number() const { return number_; }

  private:
    fs::path file_;
    std::string data_;
    std::size_t position_ = 0, last_ = 0, number_ = 0;
};

/// Splits one line into blank-separated fields and converts them, independently of the locale.
class Fields {
  public:
    Fields(const Lines& lines, std::string_view line) : lines_(lines), rest_(line) { skip_blanks(); }

    std::string_view token(const char* field) {
        const std::size_t end = std::min(rest_.find_first_of(kBlanks), rest_.size());
        if (end == 0) fail(fmt::format("field {} is missing", field));
        const std::string_view token = rest_.substr(0, end);
        rest_.remove_prefix(end);
        skip_blanks();
        return token;
    }

    template <class T> T number(const char* field) {
        const std::string_view text = token(field);
        if (const std::optional<T> value = parse_number<T>(text)) return *value;
        fail(fmt::format("field {} is '{}'; must be a number in range{}", field, text,
                         text.find(',') == std::string_view::npos
                             ? ""
                             : ", with a decimal point and not a comma (commas come from the language settings of the "
                               "program that wrote the file: write it again with LC_ALL=C)"));
    }

    /// Returns the rest of the line, without trailing blanks.
    std::string_view rest() const { return rest_.substr(0, rest_.find_last_not_of(kBlanks) + 1); }

    [[noreturn]] void fail(const std::string& what) const {
        throw DataError(fmt::format("{}: line {}: {}", lines_.file().string(), lines_.number(), what));
    }

  private:
    void skip_blanks() { rest_.remove_prefix(std::min(rest_.find_first_not_of(kBlanks), rest_.size())); }

    const Lines& lines_;
    std::string_view rest_;
};

void read_text_camera(const Lines& lines, Fields& fields, std::uint32_t id, ModelBuilder& builder) {
    const std::string_view name = fields.token("MODEL");
    const CameraModelInfo* info = nullptr;
    for (const CameraModelInfo& candidate : camera_models())
        if (candidate.name == name) info = &candidate;
    if (!info) fields.fail(fmt::format("MODEL is '{}', which is not a camera model of COLMAP", name));
    const auto width = fields.number<std::uint64_t>("WIDTH"), height = fields.number<std::uint64_t>("HEIGHT");
    std::array<double, 16> params;
    const std::size_t num_params = info->num_params();
    for (std::size_t i = 0; i < num_params; ++i) params[i] = fields.number<double>("PARAMS");
    if (!fields.rest().empty())
        fields.fail(fmt::format("'{}' after the {} parameters of {}", fields.rest(), num_params, name));
    builder.add_camera(lines.file(), id, info->id, width, height, std::span(params).first(num_params));
}

void read_text_cameras(const fs::path& file, ModelBuilder& builder) {
    Lines lines(file);
    for (std::string_view line; lines.next(line);) {
        Fields fields(lines, line);
        const auto id = fields.number<std::uint32_t>("CAMERA_ID");
        std::string fault;
        try {
            read_text_camera(lines, fields, id, builder);
        } catch (const DataError& error) {
            fault = error.what();
        }
        if (!fault.empty()) builder.add_unusable_camera(file, id, std::move(fault));
    }
}

/// The kinds of lines in images.txt, distinguished by their fields.
enum class ImageLine { kImage, kPoints, kOther };

/// Distinguishes image lines from lines of 2D points, which are triples of numbers. An image line has an id, seven
/// numbers, the id of its camera and a name.
ImageLine kind_of(std::string_view line) {
    constexpr std::size_t kCameraId = 8, kName = 9;
    std::size_t count = 0;
    bool image = true, numbers = true;
    while (!is_blank(line)) {
        line.remove_prefix(line.find_first_not_of(kBlanks));
        const std::string_view field = line.substr(0, line.find_first_of(kBlanks));
        line.remove_prefix(field.size());
        const bool number = parse_number<double>(field).has_value();
        if (count == 0 || count == kCameraId) image = image && parse_number<std::uint32_t>(field);
        image = image && (number || count >= kName);
        numbers = numbers && number;
        ++count;
        if (!image && !numbers) return ImageLine::kOther;
    }
    if (image && count > kName && !(numbers && count % 3 == 0)) return ImageLine::kImage;
    return numbers ? ImageLine::kPoints : ImageLine::kOther;
}

/// Reads the line of an image's 2D points. The line is empty if there are no points, and some programs omit it.
std::string_view read_points2d(Lines& lines) {
    std::string_view line;
    do
        if (!lines.next_raw(line)) return {};
    while (is_comment(line));
    if (is_blank(line)) return {};
    if (kind_of(line) == ImageLine::kPoints) return line;
    lines.put_back();
    return {};
}

/// Returns the observations of a line of 2D points, whose fields are numbers. Points that are cut short are left out.
std::vector<ColmapObservation> parse_points2d(Lines& lines, std::string_view line) {
    std::vector<double> values;
    for (Fields fields(lines, line); !fields.rest().empty();) values.push_back(fields.number<double>("POINTS2D"));
    std::vector<ColmapObservation> out;
    for (std::size_t i = 0; i + 2 < values.size(); i += 3)
        if (values[i + 2] >= 0)  // -1 = no point
            out.push_back({float(values[i]), float(values[i + 1]), std::uint64_t(values[i + 2])});
    return out;
}

void read_text_images(const fs::path& file, ModelBuilder& builder) {
    Lines lines(file);
    for (std::string_view line; lines.next(line);) {
        Fields fields(lines, line);
        const auto id = fields.number<std::uint32_t>("IMAGE_ID");
        std::array<double, 7> pose;
        for (double& value : pose) value = fields.number<double>("pose");
        const auto camera_id = fields.number<std::uint32_t>("CAMERA_ID");
        // COLMAP writes names without blanks, but a name with blanks is unambiguous here because it ends the line.
        const std::string name(fields.rest());
        builder.add_image(file, id, pose, camera_id, name, parse_points2d(lines, read_points2d(lines)));
    }
}

}  // namespace

void read_text(const fs::path& folder, ModelBuilder& builder) {
    read_text_cameras(folder / "cameras.txt", builder);
    read_text_images(folder / "images.txt", builder);
}

void read_text_points(const fs::path& file, ModelBuilder& builder) {
    Lines lines(file);
    bool whole_numbers = true;
    double brightest = 0;
    for (std::string_view line; lines.next(line);) {
        Fields fields(lines, line);
        const auto id = fields.number<std::uint64_t>("POINT3D_ID");
        Eigen::Vector3d position, rgb;
        for (double& value : position) value = fields.number<double>("position");
        for (double& value : rgb) {
            value = fields.number<double>("colour");
            if (!(value >= 0 && value <= 255)) fields.fail(fmt::format("colour {} is outside 0..255", value));
            brightest = std::max(brightest, value);
            whole_numbers = whole_numbers && value == std::floor(value);
        }
        builder.add_point(file, id, position, rgb);
    }
    if (whole_numbers || brightest > 1) return;
    builder.set_unit_colors();
    builder.note(fmt::format("{}: no colour is above 1: they are taken for 0..1 instead of 0..255", file.string()));
}

std::uint64_t count_text_images(const fs::path& file) {
    Lines lines(file);
    std::uint64_t count = 0;
    for (std::string_view line; lines.next(line); read_points2d(lines)) ++count;
    return count;
}

}  // namespace gs::colmap
