// SPDX-License-Identifier: Apache-2.0
// Decodes a packed scene into a model, and computes its colours.
#include "lib/export/packed_model.h"

#include <algorithm>
#include <cmath>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/parallel.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

/// The largest logit written: its opacity is 1 in single precision.
constexpr double kOpaque = 17;

/// Applies the colour activation (docs/math/appearance.md) to a value that already includes the shift.
double show(PackedColorActivation kind, double x) {
    switch (kind) {
        case PackedColorActivation::kRelu:
            return std::max(x, 0.0);
        case PackedColorActivation::kSoftplus:
            return softplus(10 * x) / 10;
        case PackedColorActivation::kSigmoid:
            return sigmoid(4 * x);
        case PackedColorActivation::kSaturatedExp:
            return -std::expm1(-x);
        case PackedColorActivation::kHardSigmoid:
            return std::clamp(x, 0.0, 1.0);
        case PackedColorActivation::kNone:
            return x;
    }
    return x;
}

bool is_shifted(PackedColorActivation kind) {
    return kind != PackedColorActivation::kSigmoid && kind != PackedColorActivation::kSaturatedExp;
}

}  // namespace

Vec3<double> packed_base(const PackedScene& scene, std::int64_t row) {
    const auto base = decode_geometry(scene.geometry[std::size_t(row)], scene.base_range).base;
    if (!scene.exponential_base) return {base[0], base[1], base[2]};
    const double shift = is_shifted(scene.activation) ? 0.5 : 0;
    return {std::exp(3 * base[0]) + shift, std::exp(3 * base[1]) + shift, std::exp(3 * base[2]) + shift};
}

Vec3<double> packed_color(const PackedScene& scene, std::int64_t row, const Vec3<double>& direction) {
    const Vec3<double> y = packed_base(scene, row) +
                           packed_residual(packing_of(scene.appearance.header.model), scene.appearance, row, direction);
    return {show(scene.activation, y.x), show(scene.activation, y.y), show(scene.activation, y.z)};
}

Gaussians packed_geometry(const PackedScene& scene) {
    Gaussians g;
    g.count = scene.count(), g.antialiased = scene.antialiased;
    g.appearance = plain_sh_appearance(0);
    for (int k = 0; k < kNumGroups; ++k) {
        g.groups[k].width = group_width(Group(k), g.appearance);
        g.groups[k].param.resize(std::size_t(g.count * g.groups[k].width));
    }
    parallel_for_rows(g.count, [&](std::int64_t i) {
        const PackedGeometry decoded = decode_geometry(scene.geometry[std::size_t(i)], scene.base_range);
        const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
        for (int c = 0; c < 3; ++c) {
            row(Group::kMean)[c] = float(decoded.mean[std::size_t(c)]);
            row(Group::kScale)[c] = float(std::log(std::max(decoded.scale[std::size_t(c)], 1e-30)));
        }
        for (int c = 0; c < 4; ++c) row(Group::kRotation)[c] = float(decoded.rotation[std::size_t((c + 3) % 4)]);
        *row(Group::kOpacity) = float(std::clamp(std::log(decoded.opacity / (1 - decoded.opacity)), -kOpaque, kOpaque));
    });
    return g;
}

void set_packed_colors(const PackedScene& scene, const Vec3<double>& position, Gaussians& model) {
    parallel_for_rows(scene.count(), [&](std::int64_t i) {
        const float* mean = model[Group::kMean].param.data() + 3 * i;
        const Vec3<double> direction = view_direction<double>({mean[0], mean[1], mean[2]}, position).unit;
        const Vec3<double> color = packed_color(scene, i, direction);
        float* base = model[Group::kBase].param.data() + 3 * i;
        // phi adds the half again
        base[0] = float(color.x - 0.5), base[1] = float(color.y - 0.5), base[2] = float(color.z - 0.5);
    });
}

}  // namespace gs
