// SPDX-License-Identifier: Apache-2.0
// PPISP on the CPU. Rows run in parallel, and their sums are added in order.
#include <algorithm>
#include <string>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/state/adam_device.h"

namespace gs {

void check_isp_view(const PpispState& state, const IspView& view) {
    const auto check = [](const char* what, int index, int least, int count) {
        if (index >= least && index < count) return;
        throw UsageError("the view needs " + std::string(what) + " " + std::to_string(index) +
                         ", but the model's PPISP has " + std::to_string(count) + " " + what + "s");
    };
    check("camera", view.camera, 0, state.num_cameras);
    if (view.mode == IspMode::kFrame) check("frame", view.frame, -1, state.num_frames);
}

void check_distillation(const PpispState& state, const IspView& view) {
    if (!state.active() || state.controller.empty()) throw UsageError("cannot train controllers: the model has none");
    if (view.mode != IspMode::kController)
        throw UsageError("cannot train a controller on a view that it does not correct");
}

void allocate_moments(PpispState& state) {
    for (auto* moments : {&state.m, &state.v}) moments->resize(state.param.size(), 0.0f);
    for (auto* moments : {&state.controller_m, &state.controller_v}) moments->resize(state.controller.size(), 0.0f);
}

void drop_moments(PpispState& state) {
    for (auto* moments : {&state.m, &state.v, &state.controller_m, &state.controller_v}) moments->clear();
}

bool step_values(float* param, float* m, float* v, const float* gradient, std::int64_t n, double rate, std::int64_t t,
                 int views) {
    for (std::int64_t i = 0; i < n; ++i)
        if (!gs_isfinite(gradient[i])) return false;
    const AdamStep<float> step = AdamStep<float>::at(rate, t);
    const AdamGains<float> gains = AdamGains<float>::of(views);
    parallel_for_rows(n, [&](std::int64_t i) { adam_update(param[i], m[i], v[i], gradient[i], step, gains); });
    return true;
}

void add_isp_gradient(const PpispState& state, const IspView& view, const float (&dL_dframe)[kIspFrameValues],
                      const float (&dL_dcamera)[kIspCameraValues], std::vector<float>& gradient) {
    if (view.mode == IspMode::kFrame && view.frame >= 0)
        for (int k = 0; k < kIspFrameValues; ++k)
            gradient[view.frame * std::size_t(kIspFrameValues) + k] += dL_dframe[k];
    for (int k = 0; k < kIspCameraValues; ++k) gradient[state.camera_offset(view.camera) + k] += dL_dcamera[k];
}

void ViewCorrection::apply(const PpispState& state, const IspView& view, const float* image, int width, int height,
                           float* out) {
    check_isp_view(state, view);
    view_ = view, width_ = width, height_ = height;
    std::fill_n(raw_frame_, kIspFrameValues, 0.0f);
    if (view.mode == IspMode::kFrame && view.frame >= 0)
        std::copy_n(state.param.data() + view.frame * std::size_t(kIspFrameValues), kIspFrameValues, raw_frame_);
    if (view.mode == IspMode::kController && !state.controller.empty())
        controller_.forward(state.controller.data() + view.camera * std::size_t(kControllerWeights), image, width,
                            height, view.prior_exposure, raw_frame_);
    std::copy_n(state.param.data() + state.camera_offset(view.camera), kIspCameraValues, raw_camera_);
    frame_ = isp_frame(raw_frame_), camera_ = isp_camera(raw_camera_);
    const std::size_t pixels = std::size_t(width) * height;
    parallel_for(height, [&](std::int64_t y) {
        for (int x = 0; x < width; ++x) {
            const std::size_t i = y * width + x;
            const Vec3<float> c = isp_forward(frame_, camera_, {image[i], image[pixels + i], image[2 * pixels + i]},
                                              isp_uv<float>(x, int(y), width, height));
            out[i] = c.x, out[pixels + i] = c.y, out[2 * pixels + i] = c.z;
        }
    });
}

void ViewCorrection::backward(const float* image, float* dL_dimage) {
    const std::size_t pixels = std::size_t(width_) * height_;
    row_sums_.assign(height_, IspSums<float>{});
    parallel_for(height_, [&](std::int64_t y) {
        for (int x = 0; x < width_; ++x) {
            const std::size_t i = y * width_ + x;
            const Vec3<float> g =
                isp_backward(frame_, camera_, {image[i], image[pixels + i], image[2 * pixels + i]},
                             isp_uv<float>(x, int(y), width_, height_),
                             {dL_dimage[i], dL_dimage[pixels + i], dL_dimage[2 * pixels + i]}, row_sums_[y]);
            dL_dimage[i] = g.x, dL_dimage[pixels + i] = g.y, dL_dimage[2 * pixels + i] = g.z;
        }
    });
    IspSums<float> sums;
    for (int k = 0; k < kIspSums; ++k) {
        double sum = 0;
        for (const IspSums<float>& row : row_sums_) sum += row.v[k];
        sums.v[k] = float(sum);
    }
    isp_finish(raw_frame_, raw_camera_, sums, dL_dframe_, dL_dcamera_);
}

bool step_ppisp(PpispState& state, std::vector<float>& gradient, double rate, int views) {
    double means[kIspFrameValues] = {}, regularizer[kIspFrameValues];
    for (int f = 0; f < state.num_frames; ++f)
        for (int k = 0; k < kIspFrameValues; ++k)
            means[k] += state.param[f * std::size_t(kIspFrameValues) + k] / double(state.num_frames);
    isp_frame_regularizer(means, std::max(state.num_frames, 1), regularizer);
    for (int f = 0; f < state.num_frames; ++f)
        for (int k = 0; k < kIspFrameValues; ++k)
            gradient[f * std::size_t(kIspFrameValues) + k] += float(regularizer[k]);
    for (int c = 0; c < state.num_cameras; ++c)
        for (int k = 0; k < kIspCameraValues; ++k)
            gradient[state.camera_offset(c) + k] +=
                float(isp_camera_regularizer(state.param.data() + state.camera_offset(c), state.num_cameras, k));
    return step_values(state.param.data(), state.m.data(), state.v.data(), gradient.data(), std::int64_t(state.size()),
                       rate, state.step, views);
}

void ViewCorrection::add_gradient(const PpispState& state, std::vector<float>& gradient) const {
    add_isp_gradient(state, view_, dL_dframe_, dL_dcamera_, gradient);
}

bool ViewCorrection::step_parameters(PpispState& state, double rate) {
    gradient_.assign(state.size(), 0.0f);
    add_gradient(state, gradient_);
    return step_ppisp(state, gradient_, rate);
}

bool ViewCorrection::step_controller(PpispState& state, const float* image, double rate) {
    if (!controller_sees(width_, height_)) return true;
    const std::size_t at = view_.camera * std::size_t(kControllerWeights);
    gradient_.resize(kControllerWeights);
    controller_.backward(state.controller.data() + at, image, dL_dframe_, gradient_.data());
    return step_values(state.controller.data() + at, state.controller_m.data() + at, state.controller_v.data() + at,
                       gradient_.data(), kControllerWeights, rate, state.controller_step);
}

}  // namespace gs
