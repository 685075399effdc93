// SPDX-License-Identifier: Apache-2.0
// PPISP and its controllers on the device, with the same computations as ppisp.h. Only .cu files include this header.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/ppisp/controller_device.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// The activations of one evaluation, and their gradients. Bins are means over blocks, (25, 32). Their encoded values
/// are the inputs of the first dense layer.
struct ControllerActivations {
    static constexpr int kGridValues = kControllerGrid * kControllerChannels, kEncoded = kControllerInputs - 1;
    float bins[kGridValues], inputs[kControllerInputs], hidden[3][kControllerHidden], out[kIspFrameValues];
    /// Gradients of the sums over the blocks of bins.
    float dL_dbins[kGridValues];
    float dL_dencoded[kEncoded], dL_dhidden[3][kControllerHidden], dL_dout[kIspFrameValues];  ///< before the activation
    /// Nonzero if a gradient of the last step was not finite.
    int nonfinite;
};

/// The input image of a controller: planar (3,H,W) on the device.
struct ControllerImage {
    const float* rgb;
    int width, height;
};

/// The controllers on the device, with the same computations as in ppisp.h.
class CudaController {
  public:
    void upload(const PpispState& state);
    void download(PpispState& state, bool with_moments) const;
    void take(Carver& c, int width, int height, bool for_step);

    /// Evaluates the controller of one camera; the result stays on the device.
    const float* forward(int camera, const ControllerImage& image, float prior_exposure, cudaStream_t stream);
    /// Takes an optimizer step of this controller. dL_dout: kIspFrameValues, on the device.
    void step(int camera, const ControllerImage& image, const float* dL_dout, double rate, std::int64_t step,
              StepControl* control, cudaStream_t stream);

    bool exists() const { return count_ > 0; }
    std::int64_t bytes() const;

  private:
    int count_ = 0;
    DeviceBuffer<float> weights_, m_, v_;  ///< (cameras, kControllerWeights)
    DeviceBuffer<ControllerActivations> activations_;
    /// The first two have one row per row of blocks; gradient_ has kControllerWeights values.
    float *row_sums_ = nullptr, *row_gradients_ = nullptr, *gradient_ = nullptr;
};

/// The prepared values of one view, and the gradient of its raw values.
struct IspDeviceView {
    IspFrame<float> frame;
    IspCamera<float> camera;
    float raw_frame[kIspFrameValues], raw_camera[kIspCameraValues], dL_dframe[kIspFrameValues],
        dL_dcamera[kIspCameraValues];
};

/// Parameters, moments and controllers on the device. It corrects one view at a time. All sums have a fixed order.
class CudaPpisp {
  public:
    /// Copies the state to the device and waits.
    void upload(const PpispState& state);
    PpispState download(bool with_moments) const;

    /// Returns the uploaded state with current step counts. Parameters that change on the device are out of date in it.
    const PpispState& host() const { return host_; }
    bool corrects(const IspView& view) const { return is_corrected(host_, view); }
    /// Counts a step of the parameters and returns its number. `rewind` reverts a number of steps.
    std::int64_t begin_step() { return ++host_.step; }
    std::int64_t begin_controller_step() { return ++host_.controller_step; }
    void rewind(std::int64_t steps, std::int64_t controller_steps) {
        host_.step -= steps, host_.controller_step -= controller_steps;
    }

    /// Takes the buffers for the calls below for a view of this size; none without PPISP.
    void take(Carver& c, int width, int height, bool for_step);
    float* corrected() const { return corrected_; }  ///< (3,H,W), room for the output of a step

    // These functions compute the same as in ViewCorrection. Steps do nothing if the step of `control` was stopped or
    // its loss is not finite.
    void apply(const IspView& view, const float* image, int width, int height, float* out, cudaStream_t stream);
    void backward(const float* image, float* dL_dimage, cudaStream_t stream);
    void step_parameters(double rate, std::int64_t step, StepControl* control, cudaStream_t stream);
    /// Waits, and adds the gradient of the view's frame and camera to `gradient` after backward().
    void add_gradient(std::vector<float>& gradient, cudaStream_t stream) const;
    void step_controller(const float* image, double rate, std::int64_t step, StepControl* control, cudaStream_t stream);

    std::int64_t bytes() const;

  private:
    PpispState host_;
    DeviceBuffer<float> param_, m_, v_, gradient_;
    DeviceBuffer<IspDeviceView> device_view_;
    CudaController controller_;
    IspView view_;
    int width_ = 0, height_ = 0;
    float *corrected_ = nullptr, *partials_ = nullptr;  ///< partials: (blocks, kIspSums)
};

}  // namespace gs
