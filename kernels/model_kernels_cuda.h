// SPDX-License-Identifier: Apache-2.0
// What the CUDA backend needs of an appearance model: two kernels. Everything else is compiled once.
#pragma once

#include "kernels/blend/blend_cuda.h"
#include "kernels/optimizer/update_device.h"

namespace gs {

struct PreprocessArgs {
    ParameterView<float> params;
    CameraParams<float> camera;
    int degree, width_padded, height_padded; ///< padded to whole tiles
    RenderMode mode;
    DepthKey depth_key;
};

struct ModelKernels {
    bool directional;
    /// Splats, spans and keys of visible Gaussians, counts of all; adds to control->num_instances and ->num_visible.
    void (*preprocess)(const PreprocessArgs&, PackedSplat*, const CudaBinningInput&, StepControl*, cudaStream_t);
    /// Gradients of all parameters from the sums, and the optimizer's step. Does nothing if the step was stopped or its
    /// loss is not finite.
    void (*update)(const PreprocessArgs&, const std::uint32_t* counts, const PackedSums*, const ModelArrays&, const UpdateArgs&, StepControl*, cudaStream_t);
};

/// The CUDA backend of a model with these kernels.
std::unique_ptr<Backend> make_cuda_backend(const ModelKernels& kernels, const BackendOptions& options);

}  // namespace gs
