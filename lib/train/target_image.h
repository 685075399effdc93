// SPDX-License-Identifier: Apache-2.0
// A decoded view as the loss reads it.
#pragma once

#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Points into `image`, which must outlive the result.
inline TargetImage target_image(const ViewImage& image) {
    TargetImage t;
    t.width = image.color.width, t.height = image.color.height, t.channels = image.color.channels;
    t.u8 = image.color.is_float() ? nullptr : image.color.u8.data();
    t.f32 = image.color.is_float() ? image.color.f32.data() : nullptr;
    t.mask = image.mask ? image.mask->u8.data() : nullptr;
    return t;
}

}  // namespace gs
