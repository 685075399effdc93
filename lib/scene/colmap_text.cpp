// SPDX-License-Identifier: Apache-2.0
// Reads the text form of a COLMAP model.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <string_view>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/colmap_checks.h"

namespace gs::colmap {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t\r";

/// Walks through the lines of a text file.
class Lines {
  public:
    explicit Lines(const fs::path& file) : file_(file), data_(read_input(file)) {}

    /// Reads the next line, including blank lines and comments; returns false at the end.
    bool next_raw(std::string_view& line) {
        if (position_ >= data_.size()) return false;
        const std::size_t end = std::min(data_.find('\n', position_), data_.size());
        line = std::string_view(data_).substr(position_, end - position_);
        position_ = end + 1;
        ++number_;
        return true;
    }

    /// Reads the next line that is neither blank nor a comment; returns false at the end.
    bool next(std::string_view& line) {
        while (next_raw(line)) {
            const std::size_t begin = line.find_first_not_of(kBlanks);
            if (begin != std::string_view::npos && line[begin] != '#') return true;
        }
        return false;
    }

    const fs::path& file() const { return file_; }
    std::size_t number() const { return number_; }

  private:
    fs::path file_;
    std::string data_;
    std::size_t position_ = 0, number_ = 0;
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
        std::string_view text = token(field);
        const std::string_view shown = text;
        if (text.starts_with('+')) text.remove_prefix(1);
        T value{};
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc() || end != text.data() + text.size())
            fail(fmt::format("field {} is '{}'; must be a number in range", field, shown));
        return value;
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

void read_text_cameras(const fs::path& file, ModelBuilder& builder) {
    Lines lines(file);
    for (std::string_view line; lines.next(line);) {
        Fields fields(lines, line);
        const auto id = fields.number<std::uint32_t>("CAMERA_ID");
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
        builder.add_camera(file, id, info->id, width, height, std::span(params).first(num_params));
    }
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
        std::string name(fields.rest());
        builder.add_image(file, id, pose, camera_id, std::move(name));
        lines.next_raw(line);  // the 2D points; an empty line if there are none
    }
}

void read_text_points(const fs::path& file, ModelBuilder& builder) {
    Lines lines(file);
    for (std::string_view line; lines.next(line);) {
        Fields fields(lines, line);
        const auto id = fields.number<std::uint64_t>("POINT3D_ID");
        Eigen::Vector3d position;
        for (double& value : position) value = fields.number<double>("position");
        std::array<int, 3> rgb;
        for (int& value : rgb) {
            value = fields.number<int>("colour");
            if (value < 0 || value > 255) fields.fail(fmt::format("colour {} is outside 0..255", value));
        }
        builder.add_point(file, id, position, rgb);
    }
}

}  // namespace

void read_text(const fs::path& folder, ModelBuilder& builder) {
    read_text_cameras(folder / "cameras.txt", builder);
    read_text_images(folder / "images.txt", builder);
    if (path_exists(folder / "points3D.txt")) read_text_points(folder / "points3D.txt", builder);
}

}  // namespace gs::colmap
