// SPDX-License-Identifier: Apache-2.0
// PPISP on whole images on the CPU, its optimizer (docs/math/ppisp.md#optimizer, #which-values-apply), and the
// controller, which predicts exposure and colour of a view from its uncorrected image (docs/math/ppisp.md#controller).
#pragma once

#include <vector>

#include "kernels/ppisp/controller_device.h"
#include "kernels/ppisp/ppisp_device.h"
#include "kernels/requests.h"

namespace gs {

/// Evaluates controllers and their gradients. Buffers are reused from call to call.
template <class Real> class Controller {
  public:
    /// Evaluates the controller on a planar (3,H,W) image. Writes kIspFrameValues to `out`, in the layout of a frame's
    /// values; they are 0 for an image without a block (controller_sees). The result does not depend on the number of
    /// threads, to the bit.
    void forward(const Real* weights, const Real* image, int width, int height, Real prior_exposure, Real* out);

    /// Computes the gradients of the last forward(), with the same weights and image. Overwrites dL_dweights
    /// (kControllerWeights) with the gradients, or with zeros for an image without a block.
    void backward(const Real* weights, const Real* image, const Real* dL_dout, Real* dL_dweights);

  private:
    int width_ = 0, height_ = 0;
    std::vector<Real> row_sums_;       ///< (rows of blocks, 5 bins, 32)
    std::vector<Real> bins_;           ///< (25, 32) means
    std::vector<Real> inputs_[4];      ///< inputs of layers 3 to 6
    std::vector<Real> row_gradients_;  ///< (rows of blocks, kControllerBlockWeights)
};

extern template class Controller<float>;
extern template class Controller<double>;

/// Returns whether a view is corrected. If not, no part of PPISP runs for it.
inline bool is_corrected(const PpispState& state, const IspView& view) {
    return state.active() && view.mode != IspMode::kNone;
}

/// Throws UsageError if the model lacks the view's frame or camera; the message names it.
void check_isp_view(const PpispState& state, const IspView& view);
/// Throws UsageError if `Backend::distill` has nothing to train: the model has no controllers, or the view does not use
/// a controller.
void check_distillation(const PpispState& state, const IspView& view);

/// Adds zero moments if there are none.
void allocate_moments(PpispState& state);
void drop_moments(PpispState& state);

/// Takes one Adam step of n values. If a gradient is not finite, it changes nothing and returns false: the value would
/// stay in the moments for ever.
bool step_values(float* param, float* m, float* v, const float* gradient, std::int64_t n, double rate, std::int64_t t,
                 int views = 1);

/// Takes step `state.step` of all frames and cameras, with the mean `gradient` over `views` views, to which it adds the
/// regularisers. If a gradient is not finite, it changes nothing and returns false.
bool step_ppisp(PpispState& state, std::vector<float>& gradient, double rate, int views = 1);

/// Adds the gradient of one view's frame and camera to `gradient` (state.size()).
void add_isp_gradient(const PpispState& state, const IspView& view, const float (&dL_dframe)[kIspFrameValues],
                      const float (&dL_dcamera)[kIspCameraValues], std::vector<float>& gradient);

/// The correction of one view. Buffers are reused from call to call. All results are independent of the number of
/// threads, to the bit.
class ViewCorrection {
  public:
    /// Corrects the planar (3,H,W) `image` of a view for which is_corrected() is true. `out` may be `image`.
    void apply(const PpispState& state, const IspView& view, const float* image, int width, int height, float* out);

    /// Replaces dL_dimage (3,H,W), the gradient of the last apply()'s output, by the gradient of its input `image`. The
    /// output of a controller is treated as constant.
    void backward(const float* image, float* dL_dimage);

    /// Adds the gradient of the view's frame and camera to `gradient` (state.size()) after backward().
    void add_gradient(const PpispState& state, std::vector<float>& gradient) const;
    /// Calls step_ppisp with the view's gradient.
    bool step_parameters(PpispState& state, double rate);

    /// Takes step `state.controller_step` of the controller of the view's camera; `image` must be the input of apply().
    /// If a gradient is not finite, it changes nothing and returns false. An image too small for a controller changes
    /// nothing.
    bool step_controller(PpispState& state, const float* image, double rate);

  private:
    IspView view_;
    int width_ = 0, height_ = 0;
    float raw_frame_[kIspFrameValues] = {}, raw_camera_[kIspCameraValues] = {}, dL_dframe_[kIspFrameValues] = {},
          dL_dcamera_[kIspCameraValues] = {};
    IspFrame<float> frame_;
    IspCamera<float> camera_;
    Controller<float> controller_;
    std::vector<IspSums<float>> row_sums_;
    std::vector<float> gradient_;
};

}  // namespace gs
