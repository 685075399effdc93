// SPDX-License-Identifier: Apache-2.0
// Computes LPIPS over the stages of a feature net, DISTS from the moments of feature maps, and MILO's mask from the
// coarsest to the finest scale.
#include "eval/metrics/learned_metrics.h"

#include <fmt/format.h>

#include <utility>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// Shift and scale of ImageNet for inputs in [-1,1].
constexpr std::array<double, 3> kShift = {-0.030, -0.088, -0.188}, kScale = {0.458, 0.448, 0.450};

Tensor net_input(const TensorEngine& engine, const Image& image, LpipsRange range) {
    if (range == LpipsRange::kUnit) return normalized_input(engine, image, kShift, kScale);
    // Shift and scale apply to 2 v - 1.
    std::array<double, 3> offset{}, scale{};
    for (std::size_t c = 0; c < 3; ++c) offset[c] = (1 + kShift[c]) / 2, scale[c] = kScale[c] / 2;
    return normalized_input(engine, image, offset, scale);
}

constexpr std::array<double, 3> kMean = {0.485, 0.456, 0.406}, kDeviation = {0.229, 0.224, 0.225};  ///< ImageNet's
constexpr double kMeanFloor = 1e-6, kVarianceFloor = 1e-6;  ///< make a channel that is 0 in both images count as equal
constexpr int kImageChannels = 3;

/// Returns the weighted dissimilarity of two maps in one channel.
double channel_distance(const ChannelComparison& c, double alpha, double beta) {
    // This form of one minus the similarity avoids cancellation: 1 - (2 ab + c) / (aa + bb + c) = (a - b)^2 / (aa + bb
    // + c).
    const double texture =
        (c.mean_a - c.mean_b) * (c.mean_a - c.mean_b) / (c.mean_a * c.mean_a + c.mean_b * c.mean_b + kMeanFloor);
    const double structure = c.difference / (c.variance_a + c.variance_b + kVarianceFloor);
    return alpha * texture + beta * structure;
}

constexpr int kHalvings = 3;

}  // namespace

LpipsRange parse_lpips_range(const std::string& name) {
    if (name == "symmetric") return LpipsRange::kSymmetric;
    if (name == "unit") return LpipsRange::kUnit;
    throw UsageError(fmt::format("--lpips-range: '{}' is not one of symmetric, unit", name));
}

Lpips::Lpips(std::shared_ptr<const FeatureNet> net, LpipsNet kind, const std::filesystem::path& folder,
             LpipsRange range)
    : net_(std::move(net)), kind_(kind), range_(range) {
    const MetricWeights heads(folder / files(kind)[1]);
    for (std::size_t i = 0; i < net_->stages.size(); ++i) {
        const int channels = net_->stages[i].channels();
        heads_.push_back(
            net_->engine->upload(channels, 1, 1, heads.read(fmt::format("lin{}.weight", i), {1, channels, 1, 1})));
    }
}

double Lpips::operator()(const Image& a, const Image& b) const {
    require_net_size(a, b, min_side());
    const TensorEngine& engine = *net_->engine;
    const Pooling pooling = kind_ == LpipsNet::kVgg ? Pooling::kMax2 : Pooling::kMax3;
    Tensor fa = net_input(engine, a, range_), fb = net_input(engine, b, range_);
    double sum = 0;
    // Processes both images stage by stage, so that only one stage of each is in memory.
    for (std::size_t i = 0; i < net_->stages.size(); ++i) {
        fa = net_->stages[i].run(engine, std::move(fa), pooling);
        fb = net_->stages[i].run(engine, std::move(fb), pooling);
        sum += engine.direction_distance(fa, fb, heads_[i]);
    }
    return sum;
}

std::vector<std::string> Lpips::files(LpipsNet net) {
    if (net == LpipsNet::kVgg) return {"vgg16.safetensors", "lpips_vgg.safetensors"};
    return {"alexnet.safetensors", "lpips_alex.safetensors"};
}

std::string Lpips::describe(LpipsNet net, LpipsRange range) {
    return fmt::format("LPIPS 0.1, {}, {}", net == LpipsNet::kVgg ? "VGG16" : "AlexNet",
                       range == LpipsRange::kSymmetric ? "input mapped to [-1,1] (torchmetrics normalize=True)"
                                                       : "input left in [0,1] (3DGS metrics.py)");
}

Dists::Dists(std::shared_ptr<const FeatureNet> vgg16, const std::filesystem::path& folder) : net_(std::move(vgg16)) {
    const auto path = folder / files()[1];
    const MetricWeights weights(path);
    int channels = kImageChannels;
    for (const NetStage& stage : net_->stages) channels += stage.channels();
    alpha_ = weights.read("alpha", {1, channels, 1, 1});
    beta_ = weights.read("beta", {1, channels, 1, 1});
    for (int i = 0; i < channels; ++i) weight_sum_ += double(alpha_[std::size_t(i)]) + beta_[std::size_t(i)];
    if (!(weight_sum_ > 0))
        throw DataError(path.string() + ": tensors 'alpha' and 'beta' do not add up to more than 0");
}

double Dists::operator()(const Image& a, const Image& b) const {
    require_net_size(a, b, kMinSide);
    const TensorEngine& engine = *net_->engine;
    double sum = 0;
    std::size_t channel = 0;
    const auto add = [&](const Tensor& fa, const Tensor& fb) {
        for (const ChannelComparison& comparison : engine.compare_channels(fa, fb)) {
            sum += channel_distance(comparison, alpha_[channel], beta_[channel]);
            ++channel;
        }
    };
    add(normalized_input(engine, a, {0, 0, 0}, {1, 1, 1}), normalized_input(engine, b, {0, 0, 0}, {1, 1, 1}));
    Tensor fa = normalized_input(engine, a, kMean, kDeviation), fb = normalized_input(engine, b, kMean, kDeviation);
    for (const NetStage& stage : net_->stages) {
        fa = stage.run(engine, std::move(fa), Pooling::kL2);
        fb = stage.run(engine, std::move(fb), Pooling::kL2);
        add(fa, fb);
    }
    return sum / weight_sum_;
}

Milo::Milo(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& folder)
    : engine_(std::move(engine)) {
    const MetricWeights weights(folder / files()[0]);
    int in = 7, index = 0;  // two images and a mask
    for (const int out : {32, 64, 32, 16, 1}) {
        layers_.push_back(
            weights.read_layer(*engine_, fmt::format("mask_finder_1.netBasic.{}", index), {in, out, 3, 1, 1}));
        in = out;
        index += 2;  // torchvision numbers the ReLU as a layer
    }
}

double Milo::operator()(const Image& render, const Image& truth) const {
    require_net_size(render, truth, kMinSide);
    // The finest scale comes first.
    std::vector<Tensor> truths = {normalized_input(*engine_, truth, {0, 0, 0}, {1, 1, 1})},
                        renders = {normalized_input(*engine_, render, {0, 0, 0}, {1, 1, 1})};
    for (int i = 0; i < kHalvings; ++i) {
        truths.push_back(engine_->average_pool(truths.back()));
        renders.push_back(engine_->average_pool(renders.back()));
    }
    const int height = truths.back().height / 2, width = truths.back().width / 2;
    Tensor mask = engine_->upload(1, height, width, std::vector<float>(std::size_t(height) * width));
    for (int i = kHalvings; i >= 0; --i) {
        const Tensor coarse = engine_->upsample_aligned(mask, truths[i].height, truths[i].width);
        mask = engine_->stacked({truths[i], renders[i], coarse});
        for (const ConvLayer& layer : layers_) mask = engine_->convolve(mask, layer, &layer != &layers_.back());
        mask = engine_->add_logistic(mask, coarse);
    }
    return engine_->masked_difference(mask, truths[0], renders[0]);
}

}  // namespace gs
