// SPDX-License-Identifier: Apache-2.0
// Views at another size.
#pragma once

#include "lib/scene/scene.h"

namespace gs {

/// The same picture in width x height pixels: intrinsics to match.
Camera resized(Camera camera, int width, int height);

/// Image and mask, by a box filter where they shrink; as they are where the size is that already.
ViewImage resized(ViewImage image, int width, int height);

/// `view` at most `width` pixels wide, at least 1 pixel high. One that is not wider stays as it is.
View smaller_view(View view, int width);

}  // namespace gs
