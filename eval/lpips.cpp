// SPDX-License-Identifier: Apache-2.0
// LPIPS over the stages of a feature net.
#include "eval/lpips.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "eval/metric_weights.h"
#include "kernels/core/error.h"
#include "kernels/core/parallel.h"

namespace gs {
namespace {

/// Statistics of ImageNet, for inputs in [-1,1].
constexpr std::array<double, 3> kShift = {-0.030, -0.088, -0.188}, kScale = {0.458, 0.448, 0.450};
constexpr double kEpsilon = 1e-10;  ///< keeps features that are zero in all channels at zero

FeatureMap net_input(const Image& image, LpipsRange range) {
    if (range == LpipsRange::kUnit) return normalized_input(image, kShift, kScale);
    // 2 v - 1, shifted and scaled.
    std::array<double, 3> offset{}, scale{};
    for (std::size_t c = 0; c < 3; ++c) offset[c] = (1 + kShift[c]) / 2, scale[c] = kScale[c] / 2;
    return normalized_input(image, offset, scale);
}

/// Mean over pixels of the weighted squared distance between the directions of the features.
double stage_distance(const FeatureMap& a, const FeatureMap& b, const std::vector<float>& weights) {
    const auto pixels = std::int64_t(a.pixels());
    std::vector<double> sums(std::size_t(num_parts(pixels)));  // summed in order afterwards
    parallel_for(num_parts(pixels), [&](std::int64_t part) {
        const std::int64_t begin = part * kPartSize, count = std::min(kPartSize, pixels - begin);
        std::vector<double> norm_a(std::size_t(count), 0.0), norm_b(std::size_t(count), 0.0);
        for (int c = 0; c < a.channels; ++c) {
            const float *va = a.plane(c) + begin, *vb = b.plane(c) + begin;
            for (std::int64_t i = 0; i < count; ++i) norm_a[i] += double(va[i]) * va[i], norm_b[i] += double(vb[i]) * vb[i];
        }
        for (std::int64_t i = 0; i < count; ++i)
            norm_a[i] = 1 / (std::sqrt(norm_a[i]) + kEpsilon), norm_b[i] = 1 / (std::sqrt(norm_b[i]) + kEpsilon);
        // Scaled in a pass of its own: fused into the subtraction, one product would be rounded and the other not, and identical
        // images would differ.
        std::vector<double> unit_a(norm_a.size()), unit_b(norm_b.size());
        for (int c = 0; c < a.channels; ++c) {
            const float *va = a.plane(c) + begin, *vb = b.plane(c) + begin;
            for (std::int64_t i = 0; i < count; ++i) unit_a[i] = va[i] * norm_a[i], unit_b[i] = vb[i] * norm_b[i];
            double sum = 0;
            for (std::int64_t i = 0; i < count; ++i) sum += (unit_a[i] - unit_b[i]) * (unit_a[i] - unit_b[i]);
            sums[std::size_t(part)] += double(weights[std::size_t(c)]) * sum;
        }
    });
    double sum = 0;
    for (const double s : sums) sum += s;
    return sum / double(pixels);
}

}  // namespace

LpipsRange parse_lpips_range(const std::string& name) {
    if (name == "symmetric") return LpipsRange::kSymmetric;
    if (name == "unit") return LpipsRange::kUnit;
    throw UsageError(fmt::format("--lpips-range: '{}' is not one of symmetric, unit", name));
}

Lpips::Lpips(const std::filesystem::path& folder, LpipsNet net, LpipsRange range) : range_(range) {
    const auto names = files(net);
    net_ = net == LpipsNet::kVgg ? load_vgg16(folder / names[0], Pooling::kMax2) : load_alexnet(folder / names[0]);
    const MetricWeights heads(folder / names[1]);
    for (std::size_t i = 0; i < net_.stages.size(); ++i)
        heads_.push_back(heads.read(fmt::format("lin{}.weight", i), {1, net_.stages[i].channels(), 1, 1}));
}

double Lpips::operator()(const Image& a, const Image& b) const {
    require_net_size(a, b, min_side());
    FeatureMap fa = net_input(a, range_), fb = net_input(b, range_);
    double sum = 0;
    // Stage by stage for both images, so that only one stage of each is held.
    for (std::size_t i = 0; i < net_.stages.size(); ++i) {
        fa = net_.stages[i].run(std::move(fa));
        fb = net_.stages[i].run(std::move(fb));
        sum += stage_distance(fa, fb, heads_[i]);
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
