// SPDX-License-Identifier: Apache-2.0
// Learned perceptual image patch similarity (LPIPS).
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "eval/metrics/feature_net.h"

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

}  // namespace gs
