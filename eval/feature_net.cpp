// SPDX-License-Identifier: Apache-2.0
// Layouts of VGG16 and AlexNet.
#include "eval/feature_net.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "eval/metric_weights.h"
#include "eval/psnr.h"
#include "kernels/core/error.h"

namespace gs {
namespace {

FeatureMap pooled(FeatureMap in, Pooling pooling) {
    switch (pooling) {
        case Pooling::kMax2: return max_pool(in, 2, 2);
        case Pooling::kMax3: return max_pool(in, 3, 2);
        case Pooling::kL2: return l2_pool(in);
        case Pooling::kNone: break;
    }
    return in;
}

}  // namespace

FeatureMap NetStage::run(FeatureMap in) const {
    FeatureMap map = pooled(std::move(in), pooling);
    for (const ConvLayer& layer : layers) map = convolve(map, layer, true);
    return map;
}

FeatureNet load_vgg16(const std::filesystem::path& file, Pooling pooling) {
    const MetricWeights weights(file);
    FeatureNet net;
    net.min_side = pooling == Pooling::kMax2 ? 16 : 1;  // four halvings that round down; l2_pool rounds up
    int in = 3, index = 0;
    for (const auto& [channels, count] : {std::pair(64, 2), {128, 2}, {256, 3}, {512, 3}, {512, 3}}) {
        NetStage stage{net.stages.empty() ? Pooling::kNone : pooling, {}};
        for (int i = 0; i < count; ++i) {
            stage.layers.push_back(weights.read_layer(fmt::format("features.{}", index), {in, channels, 3, 1, 1, {}, {}}));
            in = channels;
            index += 2;  // a ReLU follows
        }
        index += 1;  // pooling
        net.stages.push_back(std::move(stage));
    }
    return net;
}

FeatureNet load_alexnet(const std::filesystem::path& file) {
    const MetricWeights weights(file);
    FeatureNet net;
    net.min_side = 31;  // leaves 7, 3 and 1 values after the first convolution and the two poolings
    const auto add = [&](Pooling pooling, int index, ConvLayer layer) {
        net.stages.push_back({pooling, {weights.read_layer(fmt::format("features.{}", index), std::move(layer))}});
    };
    add(Pooling::kNone, 0, {3, 64, 11, 4, 2, {}, {}});
    add(Pooling::kMax3, 3, {64, 192, 5, 1, 2, {}, {}});
    add(Pooling::kMax3, 6, {192, 384, 3, 1, 1, {}, {}});
    add(Pooling::kNone, 8, {384, 256, 3, 1, 1, {}, {}});
    add(Pooling::kNone, 10, {256, 256, 3, 1, 1, {}, {}});
    return net;
}

FeatureMap normalized_input(const Image& image, const std::array<double, 3>& offset, const std::array<double, 3>& scale) {
    if (image.channels != 3) throw UsageError(fmt::format("learned metrics compare rgb images, not {} channels", image.channels));
    FeatureMap map(3, image.height, image.width);
    for (int c = 0; c < 3; ++c) {
        float* to = map.plane(c);
        for (int y = 0; y < image.height; ++y) {
            for (int x = 0; x < image.width; ++x) *to++ = float((double(image.value(x, y, c)) - offset[c]) / scale[c]);
        }
    }
    return map;
}

void require_net_size(const Image& a, const Image& b, int min_side) {
    require_same_size(a, b);
    if (std::min(a.width, a.height) < min_side)
        throw UsageError(fmt::format("{}x{} pixels are fewer than the {} in each direction that the net needs", a.width, a.height, min_side));
}

}  // namespace gs
