// SPDX-License-Identifier: Apache-2.0
// The convolutional parts of VGG16 and AlexNet, cut into five stages whose outputs learned metrics compare.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <vector>

#include "kernels/tensors/tensor_engine.h"
#include "lib/io/image.h"

namespace gs {

enum class Pooling {
    kMax2,  ///< 2x2, stride 2
    kMax3,  ///< 3x3, stride 2
    kL2     ///< TensorEngine::l2_pool
};

/// Convolutions, each with a ReLU; before them pooling where `pools`.
struct NetStage {
    bool pools = false;
    std::vector<ConvLayer> layers;

    int channels() const { return layers.back().out; }
    Tensor run(const TensorEngine& engine, Tensor in, Pooling pooling) const;
};

struct FeatureNet {
    std::shared_ptr<const TensorEngine> engine;  ///< holds the weights
    std::vector<NetStage> stages;
};

/// Stages end with relu1_2, relu2_2, relu3_3, relu4_3, relu5_3 (64, 128, 256, 512, 512 channels); metrics differ in the pooling
/// between them. File: features.N.{weight,bias} as torchvision numbers them; 59 MB. Throws DataError as MetricWeights.
/// Source: Simonyan and Zisserman 2015, configuration D. 196 billion multiply-adds for 800x800 pixels.
std::shared_ptr<const FeatureNet> load_vgg16(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& file);

/// Stages end with the five ReLUs (64, 192, 384, 256, 256 channels); pooling is kMax3. File and errors as above. Source: Krizhevsky
/// 2014, "One weird trick for parallelizing convolutional neural networks", as torchvision lays it out.
std::shared_ptr<const FeatureNet> load_alexnet(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& file);

/// (3,H,W): (value - offset) / scale by channel, of an image with 3 channels. Throws UsageError for other images.
Tensor normalized_input(const TensorEngine& engine, const Image& image, const std::array<double, 3>& offset, const std::array<double, 3>& scale);

/// Throws UsageError unless both images have one size and at least `min_side` pixels in each direction.
void require_net_size(const Image& a, const Image& b, int min_side);

}  // namespace gs
