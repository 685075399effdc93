// SPDX-License-Identifier: Apache-2.0
// MILO: absolute error weighted by a learned, multiscale visibility mask.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "kernels/tensors/tensor_engine.h"
#include "lib/io/image.h"

namespace gs {

/// The MILO metric.
class Milo {
  public:
    /// Reads mask_finder_1.netBasic.{0,2,4,6,8}.{weight,bias}, named as in the authors' MILO.pth, from milo.safetensors
    /// in `folder`. Throws DataError naming file and tensor.
    Milo(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& folder);

    /// Returns the authors' "raw error", before its remapping to opinion scores: 0 for identical images, lower is
    /// better, not symmetric. A net of five 3x3 convolutions sees truth, render and the upsampled mask of the next
    /// coarser of four scales. The result is the mean over pixels and channels of |truth - render|, weighted by the
    /// finest mask. The images have values in [0,1] and 3 channels. Throws UsageError when sizes differ or are below
    /// kMinSide. The result does not depend on the number of threads.
    /// Source: Cogalan et al. 2025, "MILO: A Lightweight Perceptual Quality Metric for Image and Latent-Space
    /// Optimization", doi 10.1145/3763340; order of the inputs, pooling and upsampling as in the authors' program
    /// (ugurcogalan06/MILO).
    double operator()(const Image& render, const Image& truth) const;

    static constexpr int kMinSide = 16;  ///< fewest pixels in either direction; the first mask has a sixteenth of them
    /// Names the files that the constructor reads.
    static std::vector<std::string> files() { return {"milo.safetensors"}; }
    /// Returns one sentence for the protocol in results.json.
    static std::string describe() {
        return "MILO raw error (mean of mask times absolute difference), images at their size in [0,1]";
    }

  private:
    std::shared_ptr<const TensorEngine> engine_;
    std::vector<ConvLayer> layers_;
};

}  // namespace gs
