// SPDX-License-Identifier: Apache-2.0
// The kernels of an appearance model for the CUDA backend. All other code of the backend is compiled once.
#pragma once

#include <cuda_fp16.h>

#include "kernels/blend/blend_cuda.h"
#include "kernels/engine.h"
#include "kernels/optimizer/lazy_cuda.h"
#include "kernels/optimizer/sum_rows_cuda.h"
#include "kernels/optimizer/update_device.h"
#include "kernels/preprocess/gaussian_device.h"
#include "kernels/sort/binning_cuda.h"
#include "kernels/splat/camera_sums_cuda.h"
#include "kernels/splat/view_report.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The weights shared by all Gaussians of a model. The pointers are null if the model has none.
struct SharedArgs {
    unsigned* prepared;  ///< weights in the format for kernels
    SparseRows sums;     ///< gradients: a row per block of the pass that computes them, if a residual is shown
};

/// Buffers of the separate pass for values that fused kernels hold in registers, (n) each. Null for fused kernels.
struct SeparateArgs {
    Vec3<float>* residuals;
    float* dL_dresiduals;    ///< (n, residual width)
    Vec3<float>* dL_dmeans;  ///< gradients of the means through the direction
};

/// One view of one model.
struct PreprocessArgs {
    ParameterView<float> params;
    CameraParams<float> camera;
    int degree, width_padded, height_padded;  ///< padded to whole tiles
    RenderMode mode;
    DepthKey depth_key;
    Cutoffs<float> cutoffs;
    LazyArgs lazy;
    SharedArgs shared;
    SeparateArgs separate;
    const __half* half_residuals;  ///< residual parameters for frames; null: use `params`
    PackedLensShape* lens_shapes;  ///< (n), written through a lens; else null
    float* camera_rows;            ///< sums of the gradients of the cameras (CudaCameraSums); null: not gathered
};

/// A view of a step on several views. Its sums may come from another rank. The pointers are on the device.
struct SplatsOfView {
    CameraParams<float> camera;
    const SplatPlaces* places;  ///< (n / 32, rounded up) of the Gaussians in `sums`
    const SplatSums<float>* sums;
};

/// The kernels of one model.
struct ModelKernels {
    bool directional;  ///< whether the model has a residual
    /// Writes splats, spans and keys of visible Gaussians, and the counts of all Gaussians. Zeroes the counters of the
    /// view. There must be at least one Gaussian.
    void (*preprocess)(const PreprocessArgs&, PackedSplat*, const CudaBinningInput&, StepControl*, cudaStream_t);
    /// Computes the gradients of all parameters from the sums, and takes the optimizer's step. Does nothing if the step
    /// was stopped or its loss is not finite.
    void (*update)(const PreprocessArgs&, const std::uint32_t* counts, const PackedSums*, const ModelArrays&,
                   const UpdateArgs&, StepControl*, cudaStream_t);
    /// Takes step `step` on the mean gradient of several views, and adds each view to the statistic of ADC. Does
    /// nothing unless *decision is kTake. Writes the sums of the shared weights' gradients over all views. Adds the
    /// number of Gaussians with a gradient that was left out to *num_nonfinite.
    void (*step_on_views)(const PreprocessArgs&, const SplatsOfView* views, int num_views, const ModelArrays&,
                          const UpdateArgs&, std::uint32_t step, const StepDecision* decision, unsigned* num_nonfinite,
                          cudaStream_t);
    struct Shared {
        int count = 0;  ///< number of weights shared by all Gaussians
        /// Size of the weights in the format for kernels, in 4-byte words, which are initially 0.
        int prepared_words = 0;
        void (*prepare)(const float* weights, unsigned* prepared, cudaStream_t) = nullptr;
        /// Number of Gaussians whose gradients a row of SharedArgs::sums adds up in step_on_views(). In update() the
        /// number is as large or larger.
        int gaussians_per_sum = 0;
    } shared;
};

/// Makes the CUDA backend of a model with these kernels.
std::unique_ptr<Engine> make_cuda_engine(const ModelKernels& kernels, const EngineOptions& options);

}  // namespace gs
