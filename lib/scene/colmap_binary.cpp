// SPDX-License-Identifier: Apache-2.0
// Reads COLMAP models in binary format (little endian, packed).
#include <fmt/format.h>

#include <bit>
#include <cstring>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/colmap_checks.h"

namespace gs::colmap {

static_assert(std::endian::native == std::endian::little,
              "COLMAP files are little endian and are read without swapping");

namespace {

namespace fs = std::filesystem;

/// Reads consecutive values; errors name the position in the file.
class Cursor {
  public:
    explicit Cursor(const fs::path& file) : file_(file), data_(read_input(file)) {}

    const fs::path& file() const { return file_; }
    std::size_t remaining() const { return data_.size() - position_; }

    template <class T> T read(const char* field) {
        T value;
        need(sizeof(T), field);
        std::memcpy(&value, data_.data() + position_, sizeof(T));
        position_ += sizeof(T);
        return value;
    }

    void skip(std::size_t bytes, const char* field) {
        need(bytes, field);
        position_ += bytes;
    }

    std::string read_name(const char* field) {
        const std::size_t end = data_.find('\0', position_);
        if (end == std::string::npos)
            fail(fmt::format("'{}' has no terminating zero byte; the file is truncated", field));
        std::string name = data_.substr(position_, end - position_);
        position_ = end + 1;
        return name;
    }

    /// Reads the count of records of at least `record_bytes` each. Throws DataError if they do not fit into the rest of
    /// the file.
    std::uint64_t read_count(const char* field, std::size_t record_bytes) {
        const std::size_t at = position_;
        const auto count = read<std::uint64_t>(field);
        if (count > remaining() / record_bytes)
            throw DataError(fmt::format(
                "{}: '{}' at byte {} is {}, which needs at least {} bytes each, but {} bytes are left; the file is "
                "truncated or not a COLMAP file",
                file_.string(), field, at, count, record_bytes, remaining()));
        return count;
    }

  private:
    void need(std::size_t bytes, const char* field) const {
        if (bytes > remaining()) fail(fmt::format("ends within '{}'; the file is truncated", field));
    }
    [[noreturn]] void fail(const std::string& what) const {
        throw DataError(fmt::format("{}: byte {} of {}: {}", file_.string(), position_, data_.size(), what));
    }

    fs::path file_;
    std::string data_;
    std::size_t position_ = 0;
};

void note_trailing(const Cursor& cursor, ModelBuilder& builder) {
    if (cursor.remaining() > 0)
        builder.note(
            fmt::format("{}: {} bytes after the last record: ignored", cursor.file().string(), cursor.remaining()));
}

void read_cameras(const fs::path& file, ModelBuilder& builder) {
    Cursor cursor(file);
    for (std::uint64_t count = cursor.read_count("number of cameras", 40); count > 0; --count) {
        const auto id = cursor.read<std::uint32_t>("camera_id");
        const auto model_id = cursor.read<std::int32_t>("model_id");
        const auto width = cursor.read<std::uint64_t>("width"), height = cursor.read<std::uint64_t>("height");
        if (model_id < 0 || std::size_t(model_id) >= camera_models().size()) {
            const std::string reason = fmt::format(
                "{}: camera {}: model_id is {}; known are 0 to {} (is the file damaged or from a newer COLMAP?)",
                file.string(), id, model_id, camera_models().size() - 1);
            // The number of parameters is unknown, and so is the beginning of the next camera.
            if (count > 1) throw DataError(reason);
            builder.add_unusable_camera(file, id, reason);
            return;
        }
        const auto model = static_cast<CameraModel>(model_id);
        std::array<double, 16> params;
        const std::size_t num_params = camera_model_info(model).num_params();
        for (std::size_t i = 0; i < num_params; ++i) params[i] = cursor.read<double>("camera parameters");
        builder.add_camera(file, id, model, width, height, std::span(params).first(num_params));
    }
    note_trailing(cursor, builder);
}

void read_images(const fs::path& file, ModelBuilder& builder) {
    Cursor cursor(file);
    for (std::uint64_t count = cursor.read_count("number of images", 73); count > 0; --count) {
        const auto id = cursor.read<std::uint32_t>("image_id");
        const auto pose = cursor.read<std::array<double, 7>>("pose");
        const auto camera_id = cursor.read<std::uint32_t>("camera_id");
        std::string name = cursor.read_name("name");
        std::vector<ColmapObservation> observations;
        for (std::uint64_t points = cursor.read_count("number of 2D points", 24); points > 0; --points) {
            const auto at = cursor.read<std::array<double, 2>>("2D points");
            const auto point = cursor.read<std::int64_t>("2D points");
            if (point >= 0) observations.push_back({float(at[0]), float(at[1]), std::uint64_t(point)});
        }
        builder.add_image(file, id, pose, camera_id, std::move(name), std::move(observations));
    }
    note_trailing(cursor, builder);
}

}  // namespace

void read_binary(const fs::path& folder, ModelBuilder& builder) {
    read_cameras(folder / "cameras.bin", builder);
    read_images(folder / "images.bin", builder);
}

void read_binary_points(const fs::path& file, ModelBuilder& builder) {
    Cursor cursor(file);
    for (std::uint64_t count = cursor.read_count("number of points", 51); count > 0; --count) {
        const auto id = cursor.read<std::uint64_t>("point3D_id");
        const auto position = cursor.read<std::array<double, 3>>("position");
        const auto rgb = cursor.read<std::array<std::uint8_t, 3>>("colour");
        cursor.skip(sizeof(double), "error");
        constexpr std::size_t kTrackElementBytes = 8;
        cursor.skip(cursor.read_count("track length", kTrackElementBytes) * kTrackElementBytes, "track");
        builder.add_point(file, id, {position[0], position[1], position[2]},
                          {double(rgb[0]), double(rgb[1]), double(rgb[2])});
    }
    note_trailing(cursor, builder);
}

}  // namespace gs::colmap
