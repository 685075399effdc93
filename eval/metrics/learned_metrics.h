// SPDX-License-Identifier: Apache-2.0
// The learned metrics: patch similarity (LPIPS), structure and texture similarity (DISTS), and MILO, absolute error
// weighted by a learned, multiscale visibility mask.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "eval/metrics/feature_net.h"
#include "kernels/tensors/tensor_engine.h"
#include "lib/io/image.h"

namespace gs {

enum class LpipsNet { kVgg, kAlex };

/// The range of the net's input. Scores by the two conventions in circulation differ by several hundredths.
enum class LpipsRange {
    kSymmetric,  ///< [-1,1], which the weights were made for: torchmetrics with normalize=True
    kUnit        ///< [0,1]: 3DGS metrics.py
};

/// Parses symmetric | unit. Throws UsageError naming these.
LpipsRange parse_lpips_range(const std::string& name);

/// The LPIPS metric on a VGG16 or an AlexNet.
class Lpips {
  public:
    /// Reads lin0..lin4.weight, each (1,C,1,1), from lpips_vgg.safetensors or lpips_alex.safetensors in `folder`. `net`
    /// is the VGG16 or AlexNet that `kind` names. Throws DataError naming file and tensor.
    Lpips(std::shared_ptr<const FeatureNet> net, LpipsNet kind, const std::filesystem::path& folder, LpipsRange range);

    /// Returns 0 for identical images and more for less similar ones; symmetric. The score is the sum over five layers
    /// of the mean over pixels of the weighted squared difference of features that have unit length in each pixel. The
    /// images have values in [0,1] and 3 channels. Throws UsageError when sizes differ or are below min_side(). The
    /// result does not depend on the number of threads.
    /// Source: Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", v0.1.
    double operator()(const Image& a, const Image& b) const;

    /// Returns the fewest pixels in either direction. VGG16 halves four times and rounds down; 31 pixels leave AlexNet
    /// 7, 3 and 1 values after the first convolution and the two poolings.
    int min_side() const { return kind_ == LpipsNet::kVgg ? 16 : 31; }
    /// Names the files of the net and of the heads.
    static std::vector<std::string> files(LpipsNet net);
    /// Returns one sentence for the protocol in results.json.
    static std::string describe(LpipsNet net, LpipsRange range);

  private:
    std::shared_ptr<const FeatureNet> net_;
    LpipsNet kind_;
    LpipsRange range_;
    std::vector<Tensor> heads_;  ///< weights of each stage's channels, (C,1,1)
};

/// The DISTS metric on a VGG16.
class Dists {
  public:
    /// Reads alpha and beta, each (1,1475,1,1), from dists.safetensors in `folder`. Throws DataError naming file and
    /// tensor.
    Dists(std::shared_ptr<const FeatureNet> vgg16, const std::filesystem::path& folder);

    /// Returns 0 for identical images and more for less similar ones; symmetric. The score is one minus a weighted sum
    /// of how well means (texture) and covariances (structure) agree, over the channels of the images and of five
    /// layers of a VGG16 with L2 pooling. The images have values in [0,1] and 3 channels and are compared at their
    /// size: the authors' script, unlike their class, first shrinks the shorter side to 256. Throws UsageError when
    /// sizes differ. The result does not depend on the number of threads.
    /// Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and Texture Similarity", eq. 6 to 8.
    double operator()(const Image& a, const Image& b) const;

    static constexpr int kMinSide = 1;  ///< fewest pixels in either direction; l2_pool rounds up
    /// Names the files of the net and of the weights.
    static std::vector<std::string> files() { return {"vgg16.safetensors", "dists.safetensors"}; }
    /// Returns one sentence for the protocol in results.json.
    static std::string describe() { return "DISTS, VGG16 with L2 pooling, images at their size in [0,1]"; }

  private:
    std::shared_ptr<const FeatureNet> net_;
    std::vector<float> alpha_, beta_;  ///< weight of each channel, (3 + 64 + 128 + 256 + 512 + 512)
    double weight_sum_ = 0;
};

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
