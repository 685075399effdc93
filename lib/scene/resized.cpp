// SPDX-License-Identifier: Apache-2.0
// Resizes cameras, images and views.
#include "lib/scene/resized.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace gs {

Camera resized(Camera camera, int width, int height) {
    const double x = double(width) / camera.width, y = double(height) / camera.height;
    camera.fx *= x, camera.cx *= x, camera.fy *= y, camera.cy *= y;
    camera.width = width, camera.height = height;
    return camera;
}

Camera with_size(Camera camera, int width, int height) {
    camera.cx += 0.5 * (width - camera.width), camera.cy += 0.5 * (height - camera.height);
    camera.width = width, camera.height = height;
    return camera;
}

Camera reduced(const Camera& camera, int factor) {
    return resized(camera, std::max(1, camera.width / factor), std::max(1, camera.height / factor));
}

ViewImage resized(ViewImage image, int width, int height) {
    if (image.color.width == width && image.color.height == height) return image;
    image.color = resize_image(image.color, width, height);
    if (image.mask) image.mask = resize_image(*image.mask, width, height);
    return image;
}

View smaller_view(View view, int width) {
    const Camera full = view.camera;
    if (full.width <= width) return view;
    const int height = std::max(1, int(std::lround(double(full.height) * width / full.width)));
    // A kept image has the full size. It need not be decoded again.
    view.load = [whole = view, width, height] { return resized(ViewImage(*view_image(whole)), width, height); };
    view.decoded = nullptr;
    view.camera = resized(full, width, height);
    view.image_bytes = std::size_t(double(view.image_bytes) * width / full.width * height / full.height);
    return view;
}

}  // namespace gs
