// SPDX-License-Identifier: Apache-2.0
// Merges and adds the filter row by row, in double.
#include "kernels/splat/smoothing.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "kernels/base/parallel.h"
#include "kernels/splat/smoothing_device.h"

namespace gs {
namespace {

/// Smallest share of a variance that is left of it without the filter, so that there is a scale to train.
constexpr double kLeastOwnShare = 0.01;

/// Replaces scale and opacity of each row i by change(i, log_scale, raw_opacity).
template <class Change> void for_each_row(Gaussians& model, Change&& change) {
    parallel_for_rows(model.count, [&](std::int64_t i) {
        float* const s = &model[Group::kScale].param[3 * std::size_t(i)];
        float& raw_opacity = model[Group::kOpacity].param[std::size_t(i)];
        const SmoothedGaussian<double> out = change(i, Vec3<double>{s[0], s[1], s[2]}, double(raw_opacity));
        s[0] = float(out.log_scale.x), s[1] = float(out.log_scale.y), s[2] = float(out.log_scale.z);
        raw_opacity = float(out.raw_opacity);
    });
}

}  // namespace

void merge_smoothing(Gaussians& model) {
    GroupArrays<float>& smoothing = model[Group::kSmoothing];
    if (smoothing.width == 0) return;
    for_each_row(model, [&](std::int64_t i, const Vec3<double>& log_scale, double raw_opacity) {
        return smoothed(log_scale, raw_opacity, double(smoothing.param[std::size_t(i)]));
    });
    smoothing = {};
}

void add_smoothing(Gaussians& model, const std::vector<CameraParams<float>>& cameras) {
    const bool was_antialiased = std::exchange(model.antialiased, true);
    GroupArrays<float>& smoothing = model[Group::kSmoothing];
    smoothing = {1, std::vector<float>(std::size_t(model.count)), {}, {}};
    for_each_row(model, [&](std::int64_t i, const Vec3<double>& log_scale, double raw_opacity) {
        const float* const m = &model[Group::kMean].param[3 * std::size_t(i)];
        float& f2 = smoothing.param[std::size_t(i)];
        f2 = smoothing_variance(Vec3<float>{m[0], m[1], m[2]}, cameras.data(), int(cameras.size()));
        if (!(f2 > 0)) return SmoothedGaussian<double>{log_scale, raw_opacity};
        if (!was_antialiased) {
            const double least = 0.5 * std::log(double(f2));
            return SmoothedGaussian<double>{
                {std::max(log_scale.x, least), std::max(log_scale.y, least), std::max(log_scale.z, least)},
                raw_opacity};
        }
        const auto own = [&](double s) {
            const double v = std::exp(2 * s);
            return 0.5 * std::log(std::max(v - double(f2), kLeastOwnShare * v));
        };
        const Vec3<double> s{own(log_scale.x), own(log_scale.y), own(log_scale.z)};
        const Vec3<double> v = activated_variance(s), filter{f2, f2, f2};
        const double opacity = sigmoid(raw_opacity) / std::sqrt(squared_smoothing_factor(v, v + filter));
        const double most = sigmoid(kMaxRawOpacity);
        return SmoothedGaussian<double>{s, opacity < most ? std::log(opacity / (1 - opacity)) : kMaxRawOpacity};
    });
}

}  // namespace gs
