// SPDX-License-Identifier: Apache-2.0
// Removes lens distortion from images. This is the one place that does: everything after it sees pinhole cameras.
#include "lib/scene/undistort.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/base/error.h"

namespace gs {
namespace {

using Eigen::Vector2d;

// Rays steeper than this (84 degrees from the axis) stretch a pinhole image beyond use, so the borders ignore them.
constexpr double kMaxTangent = 10;

/// Returns whether the model distorts the plane of a pinhole image by a polynomial. Such a lens never sees 180 degrees.
bool is_radial_polynomial(CameraModel model) {
    return model == CameraModel::kSimpleRadial || model == CameraModel::kRadial || model == CameraModel::kOpenCV ||
           model == CameraModel::kFullOpenCV;
}

/// Returns the position of a source pixel in the pinhole image of the same intrinsics.
std::optional<Vector2d> trace(const LensCamera& lens, double x, double y) {
    const auto ray = unproject(lens, {x, y});
    if (!ray || std::hypot(ray->x(), ray->y()) > kMaxTangent) return {};
    return Vector2d(lens.fx * ray->x() + lens.cx, lens.fy * ray->y() + lens.cy);
}

/// Returns the size factor of one axis: the distance of the innermost traced borders from the principal point, relative
/// to that of the original borders. Throws DataError for folded borders.
double axis_scale(double center, int size, double low_max, double high_min, const std::string& where) {
    const double low = center - low_max, high = high_min - center;
    if (!(low > 0 && high > 0))
        throw DataError(fmt::format(
            "{}: the distortion folds the image over its principal point; its parameters are damaged", where));
    const double shrink = std::max(center / low, (size - 0.5 - center) / high);
    return std::clamp(1 / shrink, 0.2, 2.0);
}

/// Samples all channels bilinearly at a pixel position inside the image; colour is premultiplied by alpha where there
/// is one.
void sample(const Image& image, double px, double py, float* out) {
    const double x = std::clamp(px - 0.5, 0.0, image.width - 1.0), y = std::clamp(py - 0.5, 0.0, image.height - 1.0);
    const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
    const float fx = float(x - x0), fy = float(y - y0);
    const int xs[4] = {x0, x1, x0, x1}, ys[4] = {y0, y0, y1, y1};
    const float weights[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
    std::fill_n(out, image.channels, 0.0f);
    for (int k = 0; k < 4; ++k) {
        const float alpha = image.channels == 4 ? image.value(xs[k], ys[k], 3) : 1.0f;
        for (int c = 0; c < image.channels; ++c)
            out[c] += weights[k] * image.value(xs[k], ys[k], c) * (c < 3 ? alpha : 1.0f);
    }
    if (image.channels == 4)
        for (int c = 0; c < 3; ++c) out[c] = out[3] > 0 ? out[c] / out[3] : 0;
}

void store(Image& image, int x, int y, const float* values) {
    const std::size_t i = (std::size_t(y) * image.width + x) * image.channels;
    for (int c = 0; c < image.channels; ++c) {
        if (image.is_float())
            image.f32[i + c] = values[c];
        else
            image.u8[i + c] = to_8_bits(values[c]);
    }
}

Image blank(int width, int height, int channels, bool is_float) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    const std::size_t samples = std::size_t(width) * height * channels;
    if (is_float)
        image.f32.assign(samples, 0.0f);
    else
        image.u8.assign(samples, 0);
    return image;
}

}  // namespace

Camera undistorted_camera(const LensCamera& lens, const std::string& where) {
    Camera camera;
    camera.width = lens.width;
    camera.height = lens.height;
    camera.fx = lens.fx;
    camera.fy = lens.fy;
    camera.cx = lens.cx;
    camera.cy = lens.cy;
    if (is_pinhole(lens)) return camera;
    if (lens.model == CameraModel::kEquirectangular)
        throw DataError(fmt::format(
            "{}: camera model EQUIRECTANGULAR has no pinhole image; split the panoramas into cube faces first", where));

    if (!(lens.cx > 0 && lens.cx < lens.width && lens.cy > 0 && lens.cy < lens.height))
        throw DataError(
            fmt::format("{}: the principal point ({:g}, {:g}) of a distorted camera lies outside its {}x{} image",
                        where, lens.cx, lens.cy, lens.width, lens.height));

    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double left = -kInfinity, right = kInfinity, top = -kInfinity, bottom = kInfinity;
    for (int y = 0; y < lens.height; ++y) {
        if (const auto p = trace(lens, 0.5, y + 0.5)) left = std::max(left, p->x());
        if (const auto p = trace(lens, lens.width - 0.5, y + 0.5)) right = std::min(right, p->x());
    }
    for (int x = 0; x < lens.width; ++x) {
        if (const auto p = trace(lens, x + 0.5, 0.5)) top = std::max(top, p->y());
        if (const auto p = trace(lens, x + 0.5, lens.height - 0.5)) bottom = std::min(bottom, p->y());
    }
    for (const double border : {left, right, top, bottom})
        if (!std::isfinite(border))
            throw DataError(fmt::format(
                "{}: no ray within 84 degrees of the axis reaches one of the borders; {}", where,
                is_radial_polynomial(lens.model)
                    ? "the distortion folds the image before them: its parameters are damaged"
                    : fmt::format(
                          "camera model {} sees nearly 180 degrees or more: convert the images to a narrower view "
                          "first",
                          camera_model_info(lens.model).name)));

    camera.width = int(std::max(1.0, axis_scale(lens.cx, lens.width, left, right, where) * lens.width));
    camera.height = int(std::max(1.0, axis_scale(lens.cy, lens.height, top, bottom, where) * lens.height));
    camera.cx *= double(camera.width) / lens.width;
    camera.cy *= double(camera.height) / lens.height;
    return camera;
}

ViewImage undistort(const ViewImage& in, const LensCamera& lens, const Camera& pinhole) {
    ViewImage out;
    out.color = blank(pinhole.width, pinhole.height, in.color.channels, in.color.is_float());
    Image mask = blank(pinhole.width, pinhole.height, 1, false);
    bool all_valid = true;
    float values[4];
    for (int y = 0; y < pinhole.height; ++y)
        for (int x = 0; x < pinhole.width; ++x) {
            const auto source =
                project(lens, {(x + 0.5 - pinhole.cx) / pinhole.fx, (y + 0.5 - pinhole.cy) / pinhole.fy, 1});
            if (!source ||
                !(source->x() >= 0 && source->y() >= 0 && source->x() <= lens.width && source->y() <= lens.height)) {
                all_valid = false;
                continue;
            }
            sample(in.color, source->x(), source->y(), values);
            store(out.color, x, y, values);
            values[0] = 1;
            if (in.mask) sample(*in.mask, source->x(), source->y(), values);
            store(mask, x, y, values);
        }
    if (in.mask || !all_valid) out.mask = std::move(mask);
    return out;
}

}  // namespace gs
