// SPDX-License-Identifier: Apache-2.0
// Resizes cameras, images and views, and takes their lenses away.
#pragma once

#include "lib/scene/scene.h"

namespace gs {

/// Returns the camera with its intrinsics scaled to an image of width x height pixels.
Camera resized(Camera camera, int width, int height);

/// The image size at which renderers are usually compared.
inline constexpr int kFrameWidth = 1280, kFrameHeight = 720;

/// Returns a pinhole camera with the same pose, the same focal lengths on the axis, and the part of the image within 50
/// degrees of the axis in each direction; a camera without a lens unchanged.
Camera without_lens(const Camera& camera);

/// Returns the view of without_lens(view.camera), whose image is resampled when loaded; views without a lens unchanged.
std::vector<View> without_lenses(std::vector<View> views);

/// Returns a pinhole camera with another image size, the same pose and focal lengths in pixels, and an unchanged image
/// centre: the principal point becomes cx + (width - W)/2, cy + (height - H)/2. A larger image shows more of the scene
/// at the same scale.
Camera with_size(Camera camera, int width, int height);

/// Returns the camera of the image with `factor` times fewer pixels per side, rounded down, at least one.
Camera reduced(const Camera& camera, int factor);

/// Resizes image and mask, with a box filter if they shrink. An image that already has this size is returned unchanged.
ViewImage resized(ViewImage image, int width, int height);

/// Returns `view` with at most `width` pixels in width and at least 1 in height. A view that is not wider is returned
/// unchanged.
View smaller_view(View view, int width);

}  // namespace gs
