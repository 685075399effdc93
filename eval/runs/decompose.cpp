// SPDX-License-Identifier: Apache-2.0
// Builds the request for a part of an image, and computes the mean of an image.
#include "eval/runs/decompose.h"

#include <algorithm>
#include <numeric>

namespace gs {

RenderRequest part_request(const CameraParams<float>& camera, const Vec3<float>& background, RenderMode mode,
                           const IspView& isp) {
    RenderRequest request;
    request.camera = camera;
    if (mode != RenderMode::kResidualOnly) request.background = background, request.isp = isp;
    request.mode = mode;
    return request;
}

double mean_value(const RenderedImage& image) {
    return std::accumulate(image.rgb.begin(), image.rgb.end(), 0.0) /
           double(std::max<std::size_t>(image.rgb.size(), 1));
}

}  // namespace gs
