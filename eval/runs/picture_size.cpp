// SPDX-License-Identifier: Apache-2.0
// Checks sizes of pictures and fits cameras to them.
#include "eval/runs/picture_size.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "kernels/base/error.h"

namespace gs {

std::optional<PictureSize> picture_size(double width, double height) {
    const auto is_side = [](double side) { return side >= 1 && side <= kMaxPictureSide && side == std::floor(side); };
    if (!is_side(width) || !is_side(height) || width * height > kMaxPicturePixels) return std::nullopt;
    return PictureSize{int(width), int(height)};
}

std::string picture_size_limits() {
    return fmt::format("a picture has 1 to {} whole pixels a side and at most {}", kMaxPictureSide, kMaxPicturePixels);
}

PictureSize parse_picture_size(const std::string& text) {
    int width = 0, height = 0;
    const char* end = text.data() + text.size();
    const auto [cross, error] = std::from_chars(text.data(), end, width);
    if (error == std::errc{} && cross != end && *cross == 'x')
        if (const auto [last, wrong] = std::from_chars(cross + 1, end, height); wrong == std::errc{} && last == end)
            if (const auto size = picture_size(width, height)) return *size;
    throw UsageError(fmt::format("--size {}: it is WIDTHxHEIGHT, such as 1280x720; {}", text, picture_size_limits()));
}

Camera with_vertical_field(Camera camera, const PictureSize& size) {
    const double scale = double(size.height) / camera.height;
    camera.fx *= scale, camera.fy *= scale, camera.cy *= scale;
    camera.cx = 0.5 * size.width + scale * (camera.cx - 0.5 * camera.width);
    camera.width = size.width, camera.height = size.height;
    return camera;
}

}  // namespace gs
