// SPDX-License-Identifier: Apache-2.0
// What the CUDA backend needs of an appearance model: its kernels. Everything else is compiled once.
#pragma once

#include <cuda_fp16.h>

#include "kernels/backend.h"
#include "kernels/blend/blend_cuda.h"
#include "kernels/optimizer/lazy_args_cuda.cuh"
#include "kernels/optimizer/update_device.h"
#include "kernels/preprocess/gaussian_device.h"
#include "kernels/sort/binning_cuda.h"

namespace gs {

/// The weights that all Gaussians of a model share; null without any.
struct SharedArgs {
    unsigned* prepared; ///< as the kernels read them
    float* sums;        ///< gradients, a row for each block of the backward pass
};

/// Where the separate pass keeps what fused kernels have in registers, one a Gaussian; null: fused.
struct SeparateArgs {
    Vec3<float>* residuals;
    float* dL_dresiduals;   ///< (n, residual width)
    Vec3<float>* dL_dmeans; ///< through the direction
};

/// One view of one model.
struct PreprocessArgs {
    ParameterView<float> params;
    CameraParams<float> camera;
    int degree, width_padded, height_padded; ///< padded to whole tiles
    RenderMode mode;
    DepthKey depth_key;
    Cutoffs<float> cutoffs;
    LazyArgs lazy;
    SharedArgs shared;
    SeparateArgs separate;
    const __half* half_residuals; ///< residual parameters as frames read them; null: those of `params`
};

struct ModelKernels {
    bool directional; ///< has a residual at all
    /// Splats, spans and keys of visible Gaussians, counts of all; adds to control->num_instances and ->num_visible.
    void (*preprocess)(const PreprocessArgs&, PackedSplat*, const CudaBinningInput&, StepControl*, cudaStream_t);
    /// Gradients of all parameters from the sums, and the optimizer's step. Does nothing if the step was stopped or its
    /// loss is not finite.
    void (*update)(const PreprocessArgs&, const std::uint32_t* counts, const PackedSums*, const ModelArrays&, const UpdateArgs&, StepControl*, cudaStream_t);
    struct Shared {
        int count = 0;          ///< weights that all Gaussians share
        int prepared_words = 0; ///< what the kernels read of them, 4-byte words, initially 0
        void (*prepare)(const float* weights, unsigned* prepared, cudaStream_t) = nullptr;
        int gaussians_per_sum = 0; ///< that a row of SharedArgs::sums is for
    } shared;
};

/// The CUDA backend of a model with these kernels.
std::unique_ptr<Backend> make_cuda_backend(const ModelKernels& kernels, const BackendOptions& options);

}  // namespace gs
