// SPDX-License-Identifier: Apache-2.0
// Deep image structure and texture similarity (DISTS).
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "eval/metrics/feature_net.h"

namespace gs {

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

}  // namespace gs
