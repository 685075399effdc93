// SPDX-License-Identifier: Apache-2.0
// DISTS from the moments of feature maps.
#include "eval/dists.h"

#include "eval/metric_weights.h"
#include "kernels/core/error.h"
#include "kernels/core/parallel.h"

namespace gs {
namespace {

constexpr std::array<double, 3> kMean = {0.485, 0.456, 0.406}, kDeviation = {0.229, 0.224, 0.225};  ///< of ImageNet
constexpr double kC1 = 1e-6, kC2 = 1e-6;  ///< keep the quotients of channels that are zero at 1
constexpr int kImageChannels = 3;

/// How much channel `c` of the two maps disagrees, weighted.
double channel_distance(const FeatureMap& a, const FeatureMap& b, int c, double alpha, double beta) {
    const float *va = a.plane(c), *vb = b.plane(c);
    const std::size_t n = a.pixels();
    double mean_a = 0, mean_b = 0;
    for (std::size_t i = 0; i < n; ++i) mean_a += va[i], mean_b += vb[i];
    mean_a /= double(n), mean_b /= double(n);
    double var_a = 0, var_b = 0, difference = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const double da = va[i] - mean_a, db = vb[i] - mean_b;
        var_a += da * da, var_b += db * db, difference += (da - db) * (da - db);
    }
    // One minus the similarities, without the cancellation: 1 - (2 ab + c) / (aa + bb + c) = (a - b)^2 / (aa + bb + c).
    const double texture = (mean_a - mean_b) * (mean_a - mean_b) / (mean_a * mean_a + mean_b * mean_b + kC1);
    const double structure = difference / double(n) / ((var_a + var_b) / double(n) + kC2);
    return alpha * texture + beta * structure;
}

}  // namespace

Dists::Dists(const std::filesystem::path& folder) : net_(load_vgg16(folder / files()[0], Pooling::kL2)) {
    const auto path = folder / files()[1];
    const MetricWeights weights(path);
    int channels = kImageChannels;
    for (const NetStage& stage : net_.stages) channels += stage.channels();
    alpha_ = weights.read("alpha", {1, channels, 1, 1});
    beta_ = weights.read("beta", {1, channels, 1, 1});
    for (int i = 0; i < channels; ++i) weight_sum_ += double(alpha_[std::size_t(i)]) + beta_[std::size_t(i)];
    if (!(weight_sum_ > 0)) throw DataError(path.string() + ": tensors 'alpha' and 'beta' do not add up to more than 0");
}

double Dists::operator()(const Image& a, const Image& b) const {
    require_net_size(a, b, min_side());
    double sum = 0;
    std::size_t first = 0;
    const auto add = [&](const FeatureMap& fa, const FeatureMap& fb) {
        std::vector<double> distances(std::size_t(fa.channels));  // summed in order afterwards
        parallel_for(fa.channels, [&](std::int64_t c) {
            distances[std::size_t(c)] = channel_distance(fa, fb, int(c), alpha_[first + std::size_t(c)], beta_[first + std::size_t(c)]);
        });
        for (const double d : distances) sum += d;
        first += std::size_t(fa.channels);
    };
    add(normalized_input(a, {0, 0, 0}, {1, 1, 1}), normalized_input(b, {0, 0, 0}, {1, 1, 1}));
    FeatureMap fa = normalized_input(a, kMean, kDeviation), fb = normalized_input(b, kMean, kDeviation);
    for (const NetStage& stage : net_.stages) {
        fa = stage.run(std::move(fa));
        fb = stage.run(std::move(fb));
        add(fa, fb);
    }
    return sum / weight_sum_;
}

}  // namespace gs
