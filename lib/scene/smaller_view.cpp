// SPDX-License-Identifier: Apache-2.0
#include "lib/scene/smaller_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace gs {

View smaller_view(View view, int width) {
    Camera& camera = view.camera;
    if (camera.width <= width) return view;
    const int height = std::max(1, int(std::lround(double(camera.height) * width / camera.width)));
    const double x = double(width) / camera.width, y = double(height) / camera.height;
    camera.fx *= x, camera.cx *= x, camera.fy *= y, camera.cy *= y;
    camera.width = width, camera.height = height;
    view.image_bytes = std::size_t(double(view.image_bytes) * x * y);
    view.load = [load = std::move(view.load), width, height] {
        ViewImage image = load();
        image.color = resize_image(image.color, width, height);
        if (image.mask) image.mask = resize_image(*image.mask, width, height);
        return image;
    };
    return view;
}

}  // namespace gs
