// SPDX-License-Identifier: Apache-2.0
// Presents a decoded view to the loss.
#pragma once

#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns a target that points into `image`, which must outlive it. `id` is the index of the view among the training
/// views, by which a device recognises the images it has kept; -1 for an image that is used once.
inline TargetImage target_image(const ViewImage& image, std::int64_t id = -1) {
    TargetImage t;
    t.id = id;
    t.width = image.color.width, t.height = image.color.height, t.channels = image.color.channels;
    t.u8 = image.color.is_float() ? nullptr : image.color.u8.data();
    t.f32 = image.color.is_float() ? image.color.f32.data() : nullptr;
    t.mask = image.mask ? image.mask->u8.data() : nullptr;
    return t;
}

}  // namespace gs
