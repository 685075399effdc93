// SPDX-License-Identifier: Apache-2.0
// PPISP on the device: the same as ppisp.h. Included by .cu files only.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/ppisp/controller_cuda.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// One view, ready for its pixels, and the gradient of its values.
struct IspDeviceView {
    IspFrame<float> frame;
    IspCamera<float> camera;
    float raw_frame[kIspFrameValues], raw_camera[kIspCameraValues], dL_dframe[kIspFrameValues], dL_dcamera[kIspCameraValues];
};

/// Parameters, moments and controllers on the device, and one view's correction at a time. All sums have a fixed order.
class CudaPpisp {
  public:
    /// Blocking copies.
    void upload(const PpispState& state);
    PpispState download(bool with_moments) const;

    /// The state as it was uploaded, with its steps counted on: what does not change on the device is true.
    const PpispState& host() const { return host_; }
    bool corrects(const IspView& view) const { return is_corrected(host_, view); }
    /// Counts a step of the parameters and returns its number. `rewind` takes so many back.
    std::int64_t begin_step() { return ++host_.step; }
    std::int64_t begin_controller_step() { return ++host_.controller_step; }
    void rewind(std::int64_t steps, std::int64_t controller_steps) { host_.step -= steps, host_.controller_step -= controller_steps; }

    /// Takes what the calls below need for a view of this size; nothing without PPISP.
    void take(Carver& c, int width, int height, bool for_step);
    float* corrected() const { return corrected_; } ///< (3,H,W), room for the output of a step

    // As those of ViewCorrection. The steps do nothing where the step of `control` was stopped or its loss is not finite.
    void apply(const IspView& view, const float* image, int width, int height, float* out, cudaStream_t stream);
    void backward(const float* image, float* dL_dimage, cudaStream_t stream);
    void step_parameters(double rate, std::int64_t step, StepControl* control, cudaStream_t stream);
    void step_controller(const float* image, double rate, std::int64_t step, StepControl* control, cudaStream_t stream);

    std::int64_t bytes() const;

  private:
    PpispState host_;
    DeviceBuffer<float> param_, m_, v_, gradient_;
    DeviceBuffer<IspDeviceView> device_view_;
    CudaController controller_;
    IspView view_;
    int width_ = 0, height_ = 0;
    float *corrected_ = nullptr, *partials_ = nullptr; ///< partials: (blocks, kIspSums)
};

}  // namespace gs
