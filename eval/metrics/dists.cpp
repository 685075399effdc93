// SPDX-License-Identifier: Apache-2.0
// Computes DISTS from the moments of feature maps.
#include "eval/metrics/dists.h"

#include <utility>

#include "eval/metrics/metric_weights.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr std::array<double, 3> kMean = {0.485, 0.456, 0.406}, kDeviation = {0.229, 0.224, 0.225};  ///< ImageNet's
constexpr double kMeanFloor = 1e-6, kVarianceFloor = 1e-6;  ///< make a channel that is 0 in both images agree
constexpr int kImageChannels = 3;

/// Returns the weighted disagreement of the two maps in one channel.
double channel_distance(const ChannelComparison& c, double alpha, double beta) {
    // This form of one minus the similarity does not cancel: 1 - (2 ab + c) / (aa + bb + c) = (a - b)^2 / (aa + bb +
    // c).
    const double texture =
        (c.mean_a - c.mean_b) * (c.mean_a - c.mean_b) / (c.mean_a * c.mean_a + c.mean_b * c.mean_b + kMeanFloor);
    const double structure = c.difference / (c.variance_a + c.variance_b + kVarianceFloor);
    return alpha * texture + beta * structure;
}

}  // namespace

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

}  // namespace gs
