// SPDX-License-Identifier: Apache-2.0
// Computes LPIPS over the stages of a feature net.
#include "eval/metrics/lpips.h"

#include <fmt/format.h>

#include <utility>

#include "eval/metrics/metric_weights.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

/// The statistics of ImageNet for inputs in [-1,1].
constexpr std::array<double, 3> kShift = {-0.030, -0.088, -0.188}, kScale = {0.458, 0.448, 0.450};

Tensor net_input(const TensorEngine& engine, const Image& image, LpipsRange range) {
    if (range == LpipsRange::kUnit) return normalized_input(engine, image, kShift, kScale);
    // These shift and scale 2 v - 1.
    std::array<double, 3> offset{}, scale{};
    for (std::size_t c = 0; c < 3; ++c) offset[c] = (1 + kShift[c]) / 2, scale[c] = kScale[c] / 2;
    return normalized_input(engine, image, offset, scale);
}

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
    // Both images take each stage together, so that only one stage of each is held.
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

}  // namespace gs
