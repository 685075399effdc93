// SPDX-License-Identifier: Apache-2.0
// PPISP on the device, which computes the same as ppisp.h. Only .cu files include this header.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/ppisp/controller_cuda.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

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

    /// Returns the uploaded state with its steps counted on. Parts that change on the device are out of date in it.
    const PpispState& host() const { return host_; }
    bool corrects(const IspView& view) const { return is_corrected(host_, view); }
    /// Counts a step of the parameters and returns its number. `rewind` takes a number of steps back.
    std::int64_t begin_step() { return ++host_.step; }
    std::int64_t begin_controller_step() { return ++host_.controller_step; }
    void rewind(std::int64_t steps, std::int64_t controller_steps) {
        host_.step -= steps, host_.controller_step -= controller_steps;
    }

    /// Takes the buffers of the calls below for a view of this size; none without PPISP.
    void take(Carver& c, int width, int height, bool for_step);
    float* corrected() const { return corrected_; }  ///< (3,H,W), room for the output of a step

    // These do the same as in ViewCorrection. Steps do nothing if the step of `control` was stopped or its loss is not
    // finite.
    void apply(const IspView& view, const float* image, int width, int height, float* out, cudaStream_t stream);
    void backward(const float* image, float* dL_dimage, cudaStream_t stream);
    void step_parameters(double rate, std::int64_t step, StepControl* control, cudaStream_t stream);
    /// Waits, and adds the gradient of the view's frame and camera after backward() to `gradient`.
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
