// SPDX-License-Identifier: Apache-2.0
// Writes small datasets for tests: COLMAP models in both forms, images, transforms files.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "kernels/base/error.h"
#include "lib/io/image.h"
#include "lib/scene/scene.h"
#include "tests/io/file_helpers.h"

namespace gs::test {

/// Appends values as they lie in memory.
class Bytes {
  public:
    template <class T> Bytes& put(T value) {
        data_.append(reinterpret_cast<const char*>(&value), sizeof(T));
        return *this;
    }
    Bytes& text(const std::string& s) {
        data_ += s;
        data_ += '\0';
        return *this;
    }
    const std::string& data() const { return data_; }

  private:
    std::string data_;
};

struct TestCamera {
    std::uint32_t id = 1;
    std::int32_t model = 1;
    std::uint64_t width = 16, height = 12;
    std::vector<double> params = {20, 20, 8, 6};
};

struct TestImage {
    std::uint32_t id = 1;
    std::vector<double> pose = {1, 0, 0, 0, 0, 0, 4};
    std::uint32_t camera_id = 1;
    std::string name = "a.png";
    int num_points2d = 0;  ///< that belong to no point
    struct Seen {
        double x, y;
        std::uint64_t point;
    };
    std::vector<Seen> seen = {};
};

struct TestPoint {
    std::uint64_t id = 1;
    double x = 0, y = 0, z = 0;
    std::uint8_t r = 255, g = 128, b = 0;
    int track = 0;
};

inline std::string cameras_bin(const std::vector<TestCamera>& cameras) {
    Bytes out;
    out.put(std::uint64_t(cameras.size()));
    for (const TestCamera& c : cameras) {
        out.put(c.id).put(c.model).put(c.width).put(c.height);
        for (const double p : c.params) out.put(p);
    }
    return out.data();
}

inline std::string images_bin(const std::vector<TestImage>& images) {
    Bytes out;
    out.put(std::uint64_t(images.size()));
    for (const TestImage& i : images) {
        out.put(i.id);
        for (const double v : i.pose) out.put(v);
        out.put(i.camera_id).text(i.name).put(std::uint64_t(i.num_points2d) + i.seen.size());
        for (int k = 0; k < i.num_points2d; ++k) out.put(1.5 * k).put(2.5).put(~std::uint64_t(0));
        for (const TestImage::Seen& s : i.seen) out.put(s.x).put(s.y).put(s.point);
    }
    return out.data();
}

inline std::string points_bin(const std::vector<TestPoint>& points) {
    Bytes out;
    out.put(std::uint64_t(points.size()));
    for (const TestPoint& p : points) {
        out.put(p.id).put(p.x).put(p.y).put(p.z).put(p.r).put(p.g).put(p.b).put(0.5).put(std::uint64_t(p.track));
        for (int k = 0; k < p.track; ++k) out.put(std::uint32_t(1)).put(std::uint32_t(k));
    }
    return out.data();
}

inline void write_model(const std::filesystem::path& folder, const std::vector<TestCamera>& cameras,
                        const std::vector<TestImage>& images, const std::vector<TestPoint>& points) {
    spit(folder / "cameras.bin", cameras_bin(cameras));
    spit(folder / "images.bin", images_bin(images));
    spit(folder / "points3D.bin", points_bin(points));
}

/// Returns an image with a gradient, so that mistakes of geometry show.
inline Image gradient_image(int width, int height, int channels = 3) {
    Image image{width, height, channels, {}, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c)
                image.u8.push_back(static_cast<std::uint8_t>(c == 3 ? 255
                                                                    : (c == 0   ? x * 255 / width
                                                                       : c == 1 ? y * 255 / height
                                                                                : 90)));
    return image;
}

inline void write_png(const std::filesystem::path& path, int width = 16, int height = 12, int channels = 3) {
    std::filesystem::create_directories(path.parent_path());
    write_image(path, gradient_image(width, height, channels));
}

/// Returns images with these names on a line, all looking along +z at points around the origin.
inline std::vector<TestImage> row_of_images(const std::vector<std::string>& names) {
    std::vector<TestImage> images;
    for (std::size_t i = 0; i < names.size(); ++i)
        images.push_back({std::uint32_t(i + 1), {1, 0, 0, 0, 0.1 * double(i), 0, 4}, 1, names[i], int(i % 3)});
    return images;
}

/// Writes a complete COLMAP scene with these images (16x12) and three points.
inline void write_colmap_scene(const std::filesystem::path& scene, const std::vector<std::string>& names) {
    write_model(scene / "sparse/0", {TestCamera{}}, row_of_images(names),
                {{1, 0, 0, 0, 255, 128, 0, 2}, {2, 0.5, 0.2, 0, 0, 0, 255, 1}, {7, -0.5, -0.2, 0.3, 9, 9, 9, 0}});
    for (const std::string& name : names) write_png(scene / "images" / name);
}

inline SceneOptions at(const std::filesystem::path& source, bool eval = false) {
    SceneOptions options;
    options.source = source.string();
    options.eval = eval;
    return options;
}

/// Loads a scene in the frame of its files, as tests state coordinates; frame_test.cpp has the scene's own frame.
inline Scene load_unframed(const SceneOptions& options) { return load_scene(options, {.frame = Frame{}}); }

inline std::string error_of(const SceneOptions& options) {
    return message_of<DataError>([&] { load_unframed(options); });
}

inline std::vector<std::string> names_of(const std::vector<View>& views) {
    std::vector<std::string> names;
    for (const View& view : views) names.push_back(view.name);
    return names;
}

/// The names a.png, b.png, ...
inline std::vector<std::string> numbered(int count) {
    std::vector<std::string> names;
    for (int i = 0; i < count; ++i) names.push_back(std::string(1, char('a' + i)) + ".png");
    return names;
}

/// One frame of a transforms.json, with further keys in `more` (", key: value").
inline std::string frame(const std::string& path, double x = 0, const std::string& more = "") {
    return "{\"file_path\": \"" + path + "\", \"transform_matrix\": [[1,0,0," + std::to_string(x) +
           "],[0,1,0,0],[0,0,1,4],[0,0,0,1]]" + more + "}";
}

/// Writes a transforms.json of these images (16x12) with further keys in `more` ("key: value, "), and the images.
inline void write_transforms_scene(const std::filesystem::path& scene, const std::vector<std::string>& names,
                                   const std::string& more = "") {
    std::string frames;
    for (const std::string& name : names) {
        frames += (frames.empty() ? "" : ",\n") + frame(name, double(frames.size()) / 1000);
        write_png(scene / name);
    }
    spit(scene / "transforms.json", "{\"fl_x\": 20, " + more + "\"frames\": [" + frames + "]}");
}

inline bool mentions(const std::vector<std::string>& notes, const std::string& part) {
    for (const std::string& note : notes)
        if (note.find(part) != std::string::npos) return true;
    return false;
}

}  // namespace gs::test
