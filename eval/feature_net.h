// SPDX-License-Identifier: Apache-2.0
// The convolutional parts of VGG16 and AlexNet, cut into five stages whose outputs learned metrics compare.
#pragma once

#include <array>
#include <filesystem>
#include <vector>

#include "eval/convolution.h"
#include "lib/io/image.h"

namespace gs {

enum class Pooling {
    kNone,
    kMax2,  ///< 2x2, stride 2
    kMax3,  ///< 3x3, stride 2
    kL2     ///< l2_pool
};

/// Pooling, then convolutions, each with a ReLU.
struct NetStage {
    Pooling pooling = Pooling::kNone;
    std::vector<ConvLayer> layers;

    int channels() const { return layers.back().out; }
    FeatureMap run(FeatureMap in) const;
};

struct FeatureNet {
    std::vector<NetStage> stages;
    int min_side = 1;  ///< images must have this many pixels in each direction
};

/// Stages end with relu1_2, relu2_2, relu3_3, relu4_3, relu5_3 (64, 128, 256, 512, 512 channels); `pooling` stands between
/// them. File: features.N.{weight,bias} as torchvision numbers them. Throws DataError as MetricWeights.
/// Source: Simonyan and Zisserman 2015, configuration D. 196 billion multiply-adds for 800x800 pixels.
FeatureNet load_vgg16(const std::filesystem::path& file, Pooling pooling);

/// Stages end with the five ReLUs (64, 192, 384, 256, 256 channels). File and errors as above. Source: Krizhevsky 2014, "One
/// weird trick for parallelizing convolutional neural networks", as torchvision lays it out.
FeatureNet load_alexnet(const std::filesystem::path& file);

/// (3,H,W): (value - offset) / scale by channel, of an image with 3 channels. Throws UsageError for other images.
FeatureMap normalized_input(const Image& image, const std::array<double, 3>& offset, const std::array<double, 3>& scale);

/// Throws UsageError unless both images have one size and at least `min_side` pixels in each direction.
void require_net_size(const Image& a, const Image& b, int min_side);

}  // namespace gs
