// SPDX-License-Identifier: Apache-2.0
// Computes single values of pooling and upsampling, for host and device.
#pragma once

#include <cstddef>

#include "kernels/base/portable.h"

namespace gs {

/// Returns the maximum of a window. `window` points to its first value, in rows of `width`.
GS_HD float max_of_window(const float* window, int width, int size) {
    float largest = *window;
    for (int ky = 0; ky < size; ++ky)
        for (int kx = 0; kx < size; ++kx) largest = gs_max(largest, window[std::size_t(ky) * width + kx]);
    return largest;
}

GS_HD float mean_of_window(const float* window, int width) {
    return (window[0] + window[1] + window[width] + window[width + 1]) * 0.25f;
}

/// Returns value (y, x) of l2_pool of a plane.
GS_HD float l2_of_window(const float* plane, int height, int width, int y, int x) {
    float sum = 0;
    for (int ky = gs_max(2 * y - 1, 0); ky <= gs_min(2 * y + 1, height - 1); ++ky)
        for (int kx = gs_max(2 * x - 1, 0); kx <= gs_min(2 * x + 1, width - 1); ++kx) {
            const float value = plane[std::size_t(ky) * width + kx];
            sum += float((ky == 2 * y ? 2 : 1) * (kx == 2 * x ? 2 : 1)) * value * value;
        }
    return gs_sqrt(sum / 16 + 1e-12f);
}

/// Returns the position of value i of a doubled axis on the axis of n values.
GS_HD float aligned_position(int i, int n) {
    return n < 2 ? 0.0f : float(gs_min(i, 2 * n - 1)) * float(n - 1) / float(2 * n - 1);
}

/// Returns value (y, x) of upsample_aligned of a plane.
GS_HD float aligned_sample(const float* plane, int height, int width, int y, int x) {
    const float fy = aligned_position(y, height), fx = aligned_position(x, width);
    const int y0 = int(fy), y1 = gs_min(y0 + 1, height - 1), x0 = int(fx), x1 = gs_min(x0 + 1, width - 1);
    const float ty = fy - float(y0), tx = fx - float(x0);
    const float *above = plane + std::size_t(y0) * width, *below = plane + std::size_t(y1) * width;
    return (1 - ty) * ((1 - tx) * above[x0] + tx * above[x1]) + ty * ((1 - tx) * below[x0] + tx * below[x1]);
}

/// Value added to a pixel's length before division. It keeps pixels that are zero in all channels at zero.
constexpr double kDirectionEpsilon = 1e-10;

}  // namespace gs
