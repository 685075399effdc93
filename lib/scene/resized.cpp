// SPDX-License-Identifier: Apache-2.0
// Resizes cameras, images and views, and takes their lenses away.
#include "lib/scene/resized.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "lib/scene/view_builder.h"

namespace gs {

Camera resized(Camera camera, int width, int height) {
    const double x = double(width) / camera.width, y = double(height) / camera.height;
    camera.fx *= x, camera.cx *= x, camera.fy *= y, camera.cy *= y;
    camera.width = width, camera.height = height;
    return camera;
}

Camera without_lens(const Camera& lens) {
    if (is_pinhole(lens)) return lens;
    Camera camera;
    camera.rotation = lens.rotation, camera.translation = lens.translation;
    const bool whole_sphere = lens.model == CameraModel::kEquirectangular;
    camera.fx = whole_sphere ? lens.fx / (2 * std::numbers::pi) : lens.fx;
    camera.fy = whole_sphere ? lens.fy / std::numbers::pi : lens.fy;
    const double most = 2 * std::tan(50 * std::numbers::pi / 180);
    camera.width = std::clamp(int(most * camera.fx), 1, lens.width);
    camera.height = std::clamp(int(most * camera.fy), 1, lens.height);
    camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    return camera;
}

std::vector<View> without_lenses(std::vector<View> views) {
    for (View& view : views) {
        if (is_pinhole(view.camera)) continue;
        const View whole = view;
        view.camera = without_lens(whole.camera);
        view.load = [whole, camera = view.camera] { return undistort(*view_image(whole), whole.camera, camera); };
        view.decoded = nullptr, view.lens_weights = nullptr;
    }
    return views;
}

Camera with_size(Camera camera, int width, int height) {
    camera = without_lens(camera);
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
    if (view.lens_weights)
        view.lens_weights = std::make_shared<const Image>(resize_image(*view.lens_weights, width, height));
    view.camera = resized(full, width, height);
    if (view.given) view.given = std::make_shared<const Camera>(resized(*view.given, width, height));
    view.image_bytes = std::size_t(double(view.image_bytes) * width / full.width * height / full.height);
    return view;
}

}  // namespace gs
