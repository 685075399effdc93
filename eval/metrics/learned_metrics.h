// SPDX-License-Identifier: Apache-2.0
// The learned metrics: patch similarity (LPIPS), structure and texture similarity (DISTS), and MILO, an absolute error
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

/// Range of the net's input. The two published conventions change scores by several hundredths.
enum class LpipsRange {
    kSymmetric,  ///< [-1,1], for which the weights were trained: torchmetrics with normalize=True
    kUnit        ///< [0,1]: 3DGS metrics.py
};

/// Parses symmetric | unit. Throws UsageError naming these.
LpipsRange parse_lpips_range(const std::string& name);

/// The LPIPS metric on a VGG16 or an AlexNet.
class Lpips {
  public:
    /// Reads lin0..lin4.weight, each (1,C,1,1), from lpips_vgg.safetensors or lpips_alex.safetensors in `folder`. `net`
    /// must be the VGG16 or AlexNet named by `kind`. Throws DataError naming file and tensor.
    Lpips(std::shared_ptr<const FeatureNet> net, LpipsNet kind, const std::filesystem::path& folder, LpipsRange range);

    /// Returns 0 for identical images and larger values for less similar ones; symmetric. The score is the sum over
    /// five layers of the mean over pixels of the weighted squared difference of features, normalized to unit length in
    /// each pixel. The images have values in [0,1] and 3 channels. Throws UsageError if sizes differ or are below
    /// min_side(). The result does not depend on the number of threads.
    /// Source: Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", v0.1.
    double operator()(const Image& a, const Image& b) const;

    /// Returns the minimum number of pixels in either direction. VGG16 halves four times and rounds down; 31 pixels
    /// leave AlexNet 7, 3 and 1 values after the first convolution and the two poolings.
    int min_side() const { return kind_ == LpipsNet::kVgg ? 16 : 31; }
    /// Returns the file names of the net and of the heads.
    static std::vector<std::string> files(LpipsNet net);
    /// Returns the description of the metric for the protocol in results.json, one sentence.
    static std::string describe(LpipsNet net, LpipsRange range);

  private:
    std::shared_ptr<const FeatureNet> net_;
    LpipsNet kind_;
    LpipsRange range_;
    std::vector<Tensor> heads_;  ///< channel weights of each stage, (C,1,1)
};

/// The DISTS metric on a VGG16.
class Dists {
  public:
    /// Reads alpha and beta, each (1,1475,1,1), from dists.safetensors in `folder`. Throws DataError naming file and
    /// tensor.
    Dists(std::shared_ptr<const FeatureNet> vgg16, const std::filesystem::path& folder);

    /// Returns 0 for identical images and larger values for less similar ones; symmetric. The score is one minus a
    /// weighted sum of the agreement of means (texture) and covariances (structure), over the channels of the images
    /// and of five layers of a VGG16 with L2 pooling. The images have values in [0,1] and 3 channels and are compared
    /// at full size: the authors' script, unlike their class, first shrinks the shorter side to 256. Throws UsageError
    /// if sizes differ. The result does not depend on the number of threads.
    /// Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and Texture Similarity", eq. 6 to 8.
    double operator()(const Image& a, const Image& b) const;

    static constexpr int kMinSide = 1;  ///< minimum pixels in either direction; l2_pool rounds up
    /// Returns the file names of the net and of the weights.
    static std::vector<std::string> files() { return {"vgg16.safetensors", "dists.safetensors"}; }
    /// Returns the description of the metric for the protocol in results.json, one sentence.
    static std::string describe() { return "DISTS, VGG16 with L2 pooling, images at their size in [0,1]"; }

  private:
    std::shared_ptr<const FeatureNet> net_;
    std::vector<float> alpha_, beta_;  ///< channel weights, (3 + 64 + 128 + 256 + 512 + 512)
    double weight_sum_ = 0;
};

/// The MILO metric.
class Milo {
  public:
    /// Reads mask_finder_1.netBasic.{0,2,4,6,8}.{weight,bias}, named as in the authors' MILO.pth, from milo.safetensors
    /// in `folder`. Throws DataError naming file and tensor.
    Milo(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& folder);

    /// Returns the authors' "raw error", before its mapping to opinion scores: 0 for identical images, lower is better,
    /// not symmetric. At each of four scales, from coarse to fine, a net of five 3x3 convolutions receives truth,
    /// render and the upsampled mask of the next coarser scale. The result is the mean over pixels and channels of
    /// |truth - render|, weighted by the finest mask. The images have values in [0,1] and 3 channels. Throws UsageError
    /// if sizes differ or are below kMinSide. The result does not depend on the number of threads.
    /// Source: Cogalan et al. 2025, "MILO: A Lightweight Perceptual Quality Metric for Image and Latent-Space
    /// Optimization", doi 10.1145/3763340; order of the inputs, pooling and upsampling as in the authors' program
    /// (ugurcogalan06/MILO).
    double operator()(const Image& render, const Image& truth) const;

    /// Minimum pixels in either direction; the initial mask has a sixteenth of them.
    static constexpr int kMinSide = 16;
    /// Returns the names of the files that the constructor reads.
    static std::vector<std::string> files() { return {"milo.safetensors"}; }
    /// Returns the description of the metric for the protocol in results.json, one sentence.
    static std::string describe() {
        return "MILO raw error (mean of mask times absolute difference), images at their size in [0,1]";
    }

  private:
    std::shared_ptr<const TensorEngine> engine_;
    std::vector<ConvLayer> layers_;
};

}  // namespace gs
