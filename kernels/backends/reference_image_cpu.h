// SPDX-License-Identifier: Apache-2.0
// The reference image of one appearance model, by the CPU rasterizer in double.
#pragma once

#include "kernels/backends/cpu_rasterizer.h"
#include "kernels/reference_image.h"

namespace gs {

template <class Model> std::vector<double> render_in_double_as(const Gaussians& model, const RenderRequest& request) {
    GaussianState<double> state;
    state.count = model.count, state.appearance = model.appearance, state.active_degree = model.active_degree;
    const auto widen = [](const GroupArrays<float>& from, GroupArrays<double>& to) {
        to.width = from.width;
        to.param.assign(from.param.begin(), from.param.end());
    };
    for (int g = 0; g < kNumGroups; ++g) widen(model.groups[g], state.groups[g]);
    widen(model.shared, state.shared);
    const auto vec = [](const Vec3<float>& v) { return Vec3<double>{v.x, v.y, v.z}; };
    const CameraParams<float>& c = request.camera;
    const CameraParams<double> camera{{vec(c.rotation.r0), vec(c.rotation.r1), vec(c.rotation.r2)},
                                      vec(c.translation),
                                      vec(c.position),
                                      c.fx,
                                      c.fy,
                                      c.cx,
                                      c.cy,
                                      c.width,
                                      c.height,
                                      c.near_plane,
                                      c.far_plane};
    const std::size_t pixels = std::size_t(c.width) * std::size_t(c.height);
    std::vector<double> image(3 * pixels), transmittance(pixels);
    CpuRasterizer<double, Model> raster;
    raster.forward(ParameterView<double>::of(state), camera, vec(request.background), state.active_degree, request.mode,
                   image.data(), transmittance.data());
    if (request.median) raster.write_medians(image.data());
    return image;
}

}  // namespace gs
