// SPDX-License-Identifier: Apache-2.0
// Deep image structure and texture similarity.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "eval/metrics/feature_net.h"

namespace gs {

class Dists {
  public:
    /// Reads dists.safetensors (alpha, beta (1,1475,1,1)) of the folder. Throws DataError naming file and tensor.
    Dists(std::shared_ptr<const FeatureNet> vgg16, const std::filesystem::path& folder);

    /// 0 for identical images, larger for less similar ones; symmetric. One minus the weighted sum, over the channels of the
    /// images and of five layers of a VGG16 with L2 pooling, of how well means (texture) and covariances (structure) agree.
    /// The images are compared at their size: the authors' script, unlike their class, first shrinks the shorter side to 256.
    /// Values in [0,1], 3 channels. Throws UsageError when sizes differ. Independent of the number of threads.
    /// Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and Texture Similarity", equations 6 to 8.
    double operator()(const Image& a, const Image& b) const;

    static constexpr int kMinSide = 1;  ///< l2_pool rounds up
    /// The files of net and weights.
    static std::vector<std::string> files() { return {"vgg16.safetensors", "dists.safetensors"}; }
    /// One sentence for the protocol in results.json.
    static std::string describe() { return "DISTS, VGG16 with L2 pooling, images at their size in [0,1]"; }

  private:
    std::shared_ptr<const FeatureNet> net_;
    std::vector<float> alpha_, beta_;  ///< (3 + 64 + 128 + 256 + 512 + 512)
    double weight_sum_ = 0;
};

}  // namespace gs
