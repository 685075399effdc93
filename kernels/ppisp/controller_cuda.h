// SPDX-License-Identifier: Apache-2.0
// The controllers on the device, which compute the same as controller.h. Only .cu files include this header.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/ppisp/controller_device.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// The activations of one evaluation, and their gradients. Bins are means over blocks, (25, 32). Their encoded values
/// are the inputs of the first dense layer.
struct ControllerActivations {
    static constexpr int kGridValues = kControllerGrid * kControllerChannels, kEncoded = kControllerInputs - 1;
    float bins[kGridValues], inputs[kControllerInputs], hidden[3][kControllerHidden], out[kIspFrameValues];
    /// The gradients of the sums over bins' blocks.
    float dL_dbins[kGridValues];
    float dL_dencoded[kEncoded], dL_dhidden[3][kControllerHidden], dL_dout[kIspFrameValues];  ///< before the activation
    /// Nonzero if a gradient of the last step was not finite.
    int nonfinite;
};

/// What a controller looks at: planar (3,H,W) on the device.
struct ControllerImage {
    const float* rgb;
    int width, height;
};

class CudaController {
  public:
    void upload(const PpispState& state);
    void download(PpispState& state, bool with_moments) const;
    void take(Carver& c, int width, int height, bool for_step);

    /// Evaluates the controller of one camera; the result stays on the device.
    const float* forward(int camera, const ControllerImage& image, float prior_exposure, cudaStream_t stream);
    /// Takes an optimizer step of that controller. dL_dout: kIspFrameValues, on the device.
    void step(int camera, const ControllerImage& image, const float* dL_dout, double rate, std::int64_t step,
              StepControl* control, cudaStream_t stream);

    bool exists() const { return count_ > 0; }
    std::int64_t bytes() const;

  private:
    int count_ = 0;
    DeviceBuffer<float> weights_, m_, v_;  ///< (cameras, kControllerWeights)
    DeviceBuffer<ControllerActivations> activations_;
    /// The first two have one row per row of blocks; gradient_ has kControllerWeights.
    float *row_sums_ = nullptr, *row_gradients_ = nullptr, *gradient_ = nullptr;
};

}  // namespace gs
