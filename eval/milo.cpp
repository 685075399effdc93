// SPDX-License-Identifier: Apache-2.0
// MILO's mask, from the coarsest scale to the finest.
#include "eval/milo.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "eval/feature_net.h"
#include "eval/metric_weights.h"

namespace gs {
namespace {

constexpr int kHalvings = 3;

/// Channels of the maps below one another; all of one size.
FeatureMap stacked(const FeatureMap& a, const FeatureMap& b, const FeatureMap& c) {
    FeatureMap out;
    out.channels = a.channels + b.channels + c.channels;
    out.height = a.height, out.width = a.width;
    out.values.reserve(out.pixels() * std::size_t(out.channels));
    for (const FeatureMap* map : {&a, &b, &c}) out.values.insert(out.values.end(), map->values.begin(), map->values.end());
    return out;
}

}  // namespace

Milo::Milo(const std::filesystem::path& folder) {
    const MetricWeights weights(folder / files()[0]);
    int in = 7, index = 0;  // two images and a mask
    for (const int out : {32, 64, 32, 16, 1}) {
        layers_.push_back(weights.read_layer(fmt::format("mask_finder_1.netBasic.{}", index), {in, out, 3, 1, 1, {}, {}}));
        in = out;
        index += 2;  // a ReLU follows
    }
}

double Milo::operator()(const Image& render, const Image& truth) const {
    require_net_size(render, truth, kMinSide);
    // Finest first.
    std::vector<FeatureMap> truths = {normalized_input(truth, {0, 0, 0}, {1, 1, 1})},
                            renders = {normalized_input(render, {0, 0, 0}, {1, 1, 1})};
    for (int i = 0; i < kHalvings; ++i) {
        truths.push_back(average_pool(truths.back()));
        renders.push_back(average_pool(renders.back()));
    }
    FeatureMap mask(1, truths.back().height / 2, truths.back().width / 2);
    for (int i = kHalvings; i >= 0; --i) {
        const FeatureMap coarse = upsample_aligned(mask, truths[i].height, truths[i].width);
        mask = stacked(truths[i], renders[i], coarse);
        for (const ConvLayer& layer : layers_) mask = convolve(mask, layer, &layer != &layers_.back());
        for (std::size_t p = 0; p < mask.values.size(); ++p) mask.values[p] = 1 / (1 + std::exp(-mask.values[p])) + coarse.values[p];
    }
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
        const float *t = truths[0].plane(c), *r = renders[0].plane(c);
        for (std::size_t p = 0; p < mask.values.size(); ++p) sum += double(mask.values[p]) * std::abs(double(t[p]) - r[p]);
    }
    return sum / (3 * double(mask.values.size()));
}

}  // namespace gs
