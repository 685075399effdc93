// SPDX-License-Identifier: Apache-2.0
// PPISP on whole images on the CPU, and its optimizer (docs/math/ppisp.md#optimizer, #which-values-apply).
#pragma once

#include <vector>

#include "kernels/ppisp/controller.h"
#include "kernels/ppisp/regularizer_device.h"
#include "kernels/requests.h"

namespace gs {

/// Whether a view is corrected at all: nothing of PPISP runs where it is not.
inline bool is_corrected(const PpispState& state, const IspView& view) { return state.active() && view.mode != IspMode::kNone; }

/// Throws UsageError naming a frame or camera that the model does not have.
void check_isp_view(const PpispState& state, const IspView& view);
/// Throws UsageError where `Backend::distill` has nothing to train: a model without controllers, a view that does not ask for one.
void check_distillation(const PpispState& state, const IspView& view);

/// Zero moments where there are none.
void allocate_moments(PpispState& state);
void drop_moments(PpispState& state);

/// One Adam step of n values. False, and nothing changes, if a gradient is not finite: one would stay in the moments for ever.
bool step_values(float* param, float* m, float* v, const float* gradient, std::int64_t n, double rate, std::int64_t t);

/// One view's correction. Buffers are reused from call to call.
class ViewCorrection {
  public:
    /// Corrects the planar (3,H,W) `image` of a view for which is_corrected. `out` may be `image`.
    /// Determinism of all: bitwise, independent of threads.
    void apply(const PpispState& state, const IspView& view, const float* image, int width, int height, float* out);

    /// Way back of the last apply: dL_dimage (3,H,W), with respect to its output, becomes that of its input `image`. With a
    /// controller, what it says counts as constant.
    void backward(const float* image, float* dL_dimage);

    /// Step `state.step` of all frames and cameras, with the view's gradient and the regularisers. False: a gradient was not
    /// finite, and nothing changes.
    bool step_parameters(PpispState& state, double rate);

    /// Step `state.controller_step` of the controller of the view's camera; `image` as of apply. False as above. An image too
    /// small for a controller leaves it as it is.
    bool step_controller(PpispState& state, const float* image, double rate);

  private:
    IspView view_;
    int width_ = 0, height_ = 0;
    float raw_frame_[kIspFrameValues] = {}, raw_camera_[kIspCameraValues] = {}, dL_dframe_[kIspFrameValues] = {}, dL_dcamera_[kIspCameraValues] = {};
    IspFrame<float> frame_;
    IspCamera<float> camera_;
    Controller<float> controller_;
    std::vector<IspSums<float>> row_sums_;
    std::vector<float> gradient_;
};

}  // namespace gs
