// SPDX-License-Identifier: Apache-2.0
// Learned perceptual image patch similarity.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "eval/metrics/feature_net.h"

namespace gs {

enum class LpipsNet { kVgg, kAlex };

/// What the net is given. The two conventions in circulation differ by several hundredths.
enum class LpipsRange {
    kSymmetric,  ///< mapped to [-1,1], what the weights were made for: torchmetrics with normalize=True
    kUnit        ///< left in [0,1]: 3DGS metrics.py
};

/// symmetric | unit. Throws UsageError naming these.
LpipsRange parse_lpips_range(const std::string& name);

class Lpips {
  public:
    /// `net`: VGG16 or AlexNet, as `kind` says. Reads lpips_vgg.safetensors or lpips_alex.safetensors (lin0..lin4.weight (1,C,1,1)) of the
    /// folder. Throws DataError naming file and tensor.
    Lpips(std::shared_ptr<const FeatureNet> net, LpipsNet kind, const std::filesystem::path& folder, LpipsRange range);

    /// 0 for identical images, larger for less similar ones; symmetric. The sum over five layers of the mean over pixels of
    /// the weighted squared difference of features that have unit length in each pixel. Values in [0,1], 3 channels. Throws
    /// UsageError when sizes differ or are below min_side(). Independent of the number of threads.
    /// Source: Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", version 0.1.
    double operator()(const Image& a, const Image& b) const;

    /// VGG16: four halvings that round down. AlexNet: leaves 7, 3 and 1 values after the first convolution and the two poolings.
    int min_side() const { return kind_ == LpipsNet::kVgg ? 16 : 31; }
    /// The files of net and heads.
    static std::vector<std::string> files(LpipsNet net);
    /// One sentence for the protocol in results.json.
    static std::string describe(LpipsNet net, LpipsRange range);

  private:
    std::shared_ptr<const FeatureNet> net_;
    LpipsNet kind_;
    LpipsRange range_;
    std::vector<Tensor> heads_;  ///< by stage: (C,1,1)
};

}  // namespace gs
