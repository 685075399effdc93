// SPDX-License-Identifier: Apache-2.0
// Packs the photometric correction that a viewer applies.
#include "lib/export/pack_ppisp.h"

#include <algorithm>
#include <numeric>

#include "kernels/ppisp/controller.h"
#include "kernels/ppisp/ppisp_device.h"

namespace gs {

PackedPpisp pack_ppisp(const PpispState& state) {
    PackedPpisp packed;
    const IspCamera<double> camera = [&] {
        const std::vector<double> raw(state.param.begin() + std::ptrdiff_t(state.camera_offset(0)), state.param.end());
        return isp_camera(raw.data());
    }();
    for (int c = 0; c < 3; ++c) {
        const IspResponse<double>& r = camera.response[c];
        const double a = r.shoulder * r.centre * r.inverse_length;
        const double values[6] = {r.toe, r.shoulder, r.gamma, r.centre, a, 1 - a};
        for (int k = 0; k < 6; ++k) packed.response[std::size_t(6 * c + k)] = float(values[k]);
    }
    if (state.num_frames == 0) return packed;
    std::vector<int> frames(static_cast<std::size_t>(state.num_frames));
    std::iota(frames.begin(), frames.end(), 0);
    const auto middle = frames.begin() + std::ptrdiff_t(frames.size() / 2);
    const auto exposure = [&](int frame) { return state.param[std::size_t(frame) * kIspFrameValues]; };
    std::nth_element(frames.begin(), middle, frames.end(), [&](int a, int b) { return exposure(a) < exposure(b); });
    std::copy_n(state.param.begin() + std::ptrdiff_t(*middle) * kIspFrameValues, kIspFrameValues,
                packed.standard.begin());
    return packed;
}

PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected) {
    PackedFrame frame{};
    if (view.mode != IspMode::kController || state.controller.empty()) return frame;
    const float* weights =
        state.controller.data() + std::size_t(std::clamp(view.camera, 0, state.num_cameras - 1)) * kControllerWeights;
    Controller<float>().forward(weights, uncorrected.rgb.data(), uncorrected.width, uncorrected.height,
                                view.prior_exposure, frame.data());
    return frame;
}

}  // namespace gs
