// SPDX-License-Identifier: Apache-2.0
// Computes MILO's mask from the coarsest scale to the finest.
#include "eval/metrics/milo.h"

#include <fmt/format.h>

#include <utility>

#include "eval/metrics/feature_net.h"
#include "eval/metrics/metric_weights.h"

namespace gs {
namespace {

constexpr int kHalvings = 3;

}  // namespace

Milo::Milo(std::shared_ptr<const TensorEngine> engine, const std::filesystem::path& folder)
    : engine_(std::move(engine)) {
    const MetricWeights weights(folder / files()[0]);
    int in = 7, index = 0;  // two images and a mask
    for (const int out : {32, 64, 32, 16, 1}) {
        layers_.push_back(
            weights.read_layer(*engine_, fmt::format("mask_finder_1.netBasic.{}", index), {in, out, 3, 1, 1}));
        in = out;
        index += 2;  // the ReLU counts as a layer
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
