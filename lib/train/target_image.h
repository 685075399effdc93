// SPDX-License-Identifier: Apache-2.0
// A decoded view as the loss reads it.
#pragma once

#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Points into `image`, which must outlive the result. `id`: index of the view among the training views, by which a device
/// knows the images it has kept; -1 for an image that comes once.
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
