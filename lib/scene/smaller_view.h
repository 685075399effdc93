// SPDX-License-Identifier: Apache-2.0
// A view through a smaller image.
#pragma once

#include "lib/scene/scene.h"

namespace gs {

/// `view` with an image at most `width` pixels wide (a box filter), at least 1 pixel high, and intrinsics to match. One that is not wider stays as it is.
View smaller_view(View view, int width);

}  // namespace gs
