// SPDX-License-Identifier: Apache-2.0
// Reads and checks the weights of learned metrics, and defines the layouts of VGG16 and AlexNet.
#include "eval/metrics/feature_net.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/metrics/pixel_metrics.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

Tensor pooled(const TensorEngine& engine, const Tensor& in, Pooling pooling) {
    if (pooling == Pooling::kL2) return engine.l2_pool(in);
    return engine.max_pool(in, pooling == Pooling::kMax2 ? 2 : 3, 2);
}

}  // namespace

std::vector<float> MetricWeights::read(const std::string& name, const std::vector<std::int64_t>& shape) const {
    const auto& stored = file_.tensor(name).shape;
    if (stored != shape)
        throw DataError(fmt::format("{}: tensor '{}' has shape ({}), expected ({})", path_.string(), name,
                                    fmt::join(stored, ","), fmt::join(shape, ",")));
    std::vector<float> values = file_.read<float>(name);
    const auto bad = std::find_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); });
    if (bad != values.end())
        throw DataError(
            fmt::format("{}: tensor '{}' holds {} at index {}", path_.string(), name, *bad, bad - values.begin()));
    return values;
}

ConvLayer MetricWeights::read_layer(const TensorEngine& engine, const std::string& name, ConvLayer layer) const {
    layer.weights = engine.upload(layer.out, layer.in, layer.kernel * layer.kernel,
                                  read(name + ".weight", {layer.out, layer.in, layer.kernel, layer.kernel}));
    layer.bias = engine.upload(layer.out, 1, 1, read(name + ".bias", {layer.out}));
    return layer;
}

Tensor NetStage::run(const TensorEngine& engine, Tensor in, Pooling pooling) const {
    if (pools) in = pooled(engine, in, pooling);
    for (const ConvLayer& layer : layers) in = engine.convolve(in, layer, true);
    return in;
}

std::shared_ptr<const FeatureNet> load_vgg16(std::shared_ptr<const TensorEngine> engine,
                                             const std::filesystem::path& file) {
    const MetricWeights weights(file);
    FeatureNet net{std::move(engine), {}};
    int in = 3, index = 0;
    for (const auto& [channels, count] : {std::pair(64, 2), {128, 2}, {256, 3}, {512, 3}, {512, 3}}) {
        NetStage stage{!net.stages.empty(), {}};
        for (int i = 0; i < count; ++i) {
            stage.layers.push_back(
                weights.read_layer(*net.engine, fmt::format("features.{}", index), {in, channels, 3, 1, 1}));
            in = channels;
            index += 2;  // torchvision numbers the ReLU as a layer
        }
        index += 1;  // torchvision numbers the pooling, too
        net.stages.push_back(std::move(stage));
    }
    return std::make_shared<const FeatureNet>(std::move(net));
}

std::shared_ptr<const FeatureNet> load_alexnet(std::shared_ptr<const TensorEngine> engine,
                                               const std::filesystem::path& file) {
    const MetricWeights weights(file);
    FeatureNet net{std::move(engine), {}};
    const auto add = [&](bool pools, int index, const ConvLayer& layer) {
        net.stages.push_back({pools, {weights.read_layer(*net.engine, fmt::format("features.{}", index), layer)}});
    };
    add(false, 0, {3, 64, 11, 4, 2});
    add(true, 3, {64, 192, 5, 1, 2});
    add(true, 6, {192, 384, 3, 1, 1});
    add(false, 8, {384, 256, 3, 1, 1});
    add(false, 10, {256, 256, 3, 1, 1});
    return std::make_shared<const FeatureNet>(std::move(net));
}

Tensor normalized_input(const TensorEngine& engine, const Image& image, const std::array<double, 3>& offset,
                        const std::array<double, 3>& scale) {
    if (image.channels != 3)
        throw UsageError(fmt::format("learned metrics compare rgb images, not {} channels", image.channels));
    std::vector<float> values;
    values.reserve(std::size_t(3) * image.height * image.width);
    for (int c = 0; c < 3; ++c) {
        for (int y = 0; y < image.height; ++y) {
            for (int x = 0; x < image.width; ++x)
                values.push_back(float((double(image.value(x, y, c)) - offset[c]) / scale[c]));
        }
    }
    return engine.upload(3, image.height, image.width, values);
}

void require_net_size(const Image& a, const Image& b, int min_side) {
    require_same_size(a, b);
    if (std::min(a.width, a.height) < min_side)
        throw UsageError(fmt::format("{}x{} pixels are fewer than the {} in each direction that the net needs", a.width,
                                     a.height, min_side));
}

}  // namespace gs
