// SPDX-License-Identifier: Apache-2.0
// Packs a trained model and its photometric correction into the scene that a viewer loads.
#include "lib/export/pack_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/ppisp/ppisp_device.h"
#include "kernels/splat/raster_config.h"
#include "lib/core/median.h"
#include "lib/export/file_rows.h"
#include "lib/export/geometry_codes.h"
#include "lib/export/turn.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/whole_model.h"

namespace gs {
namespace {

PackedColorActivation packed_activation_of(ColorActivation activation) {
    switch (activation) {
        case ColorActivation::kRelu:
            return PackedColorActivation::kRelu;
        case ColorActivation::kSoftplus:
            return PackedColorActivation::kSoftplus;
        case ColorActivation::kSigmoid:
            return PackedColorActivation::kSigmoid;
        case ColorActivation::kHardSigmoid:
            return PackedColorActivation::kHardSigmoid;
    }
    return PackedColorActivation::kNone;
}

/// Returns the shift stored with the base colour: all activations but the sigmoid add a half.
double base_shift(ColorActivation activation) { return activation == ColorActivation::kSigmoid ? 0 : 0.5; }

/// Returns the opacity that compensates the rounding of scales, whose steps are 8.6 %. The opacity compensates half of
/// the change in area, which gives the smallest squared error of a single Gaussian's image. Scales outside the range of
/// the codes are not compensated: they are smaller than any pixel or larger than any view.
double compensated_opacity(double opacity, const std::array<double, 3>& scales) {
    std::array<double, 3> rounded;
    std::transform(scales.begin(), scales.end(), rounded.begin(), [](double s) { return decode_scale(scale_code(s)); });
    const double ratio = mean_area(scales) / mean_area(rounded), step = decode_scale(2) / decode_scale(1);
    return ratio > 1 / step && ratio < step ? std::min(1.0, opacity * std::sqrt(ratio)) : opacity;
}

PackedGeometry geometry_of(const Gaussians& g, std::int64_t i, double shift) {
    const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
    const float *base = row(Group::kBase), *mean = row(Group::kMean), *scale = row(Group::kScale),
                *q = row(Group::kRotation);
    const auto size = [](float raw) { return std::exp(std::min(double(raw), kMaxLogScale)); };
    const std::array<double, 3> scales = {size(scale[0]), size(scale[1]), size(scale[2])};
    PackedGeometry geometry = {{base[0] + shift, base[1] + shift, base[2] + shift},
                               compensated_opacity(sigmoid(double(*row(Group::kOpacity))), scales),
                               {mean[0], mean[1], mean[2]},
                               scales,
                               {q[1], q[2], q[3], q[0]}};
    choose_axes(geometry);
    return geometry;
}

/// Returns the importance by which Gaussians are sorted. docs/lab/viewer.md#pictures-of-a-part lists the alternatives
/// that were tried.
double importance(const Gaussians& g, const std::vector<float>& scores, std::int64_t i) {
    const double opacity = sigmoid(double(g[Group::kOpacity].param[std::size_t(i)]));
    if (!scores.empty()) return std::sqrt(double(scores[std::size_t(i)]) * opacity);
    const float* scale = g[Group::kScale].param.data() + 3 * i;
    const auto size = [](float raw) { return std::exp(std::min(double(raw), kMaxLogScale)); };
    return opacity * std::sqrt(mean_area({size(scale[0]), size(scale[1]), size(scale[2])}));
}

/// Sorts the rows [begin, end) into importance classes.
void order_part(const std::vector<double>& values, std::vector<std::int64_t>& order, std::int64_t begin,
                std::int64_t end) {
    const auto first = order.begin();
    std::stable_sort(first + begin, first + end,
                     [&](std::int64_t a, std::int64_t b) { return values[std::size_t(a)] > values[std::size_t(b)]; });
    for (std::int64_t k = 0; k < kImportanceClasses; ++k)
        std::sort(first + begin + class_begin(end - begin, k), first + begin + class_begin(end - begin, k + 1));
}

PackedCamera packed_camera(const Camera& camera) {
    PackedCamera out{};
    const Eigen::Matrix3d axes = camera.rotation.transpose();
    const Eigen::Vector3d position = camera.center();
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) out.world_from_camera[4 * r + c] = float(axes(r, c));
        out.world_from_camera[4 * r + 3] = float(position[r]);
    }
    out.fx = float(camera.fx), out.fy = float(camera.fy), out.cx = float(camera.cx), out.cy = float(camera.cy);
    out.width = float(camera.width), out.height = float(camera.height);
    return out;
}

}  // namespace

PackedPpisp pack_ppisp(const PpispState& state) {
    PackedPpisp packed;
    const IspCamera<double> camera = [&] {
        const std::vector<double> raw(state.param.begin() + std::ptrdiff_t(state.camera_offset(0)), state.param.end());
        return isp_camera(raw.data());
    }();
    for (int c = 0; c < 3; ++c) {
        const IspResponse<double>& r = camera.response[c];
        const double a = r.shoulder * r.centre * r.inverse_length;
        const double values[6] = {r.toe, r.shoulder, r.gamma, r.centre, a, 1 - a};
        for (int k = 0; k < 6; ++k) packed.response[std::size_t(6 * c + k)] = float(values[k]);
    }
    if (state.num_frames == 0) return packed;
    std::vector<int> frames(static_cast<std::size_t>(state.num_frames));
    std::iota(frames.begin(), frames.end(), 0);
    const auto middle = frames.begin() + std::ptrdiff_t(frames.size() / 2);
    const auto exposure = [&](int frame) { return state.param[std::size_t(frame) * kIspFrameValues]; };
    std::nth_element(frames.begin(), middle, frames.end(), [&](int a, int b) { return exposure(a) < exposure(b); });
    std::copy_n(state.param.begin() + std::ptrdiff_t(*middle) * kIspFrameValues, kIspFrameValues,
                packed.standard.begin());
    return packed;
}

PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected) {
    PackedFrame frame{};
    if (view.mode != IspMode::kController || state.controller.empty()) return frame;
    const float* weights =
        state.controller.data() + std::size_t(std::clamp(view.camera, 0, state.num_cameras - 1)) * kControllerWeights;
    Controller<float>().forward(weights, uncorrected.rgb.data(), uncorrected.width, uncorrected.height,
                                view.prior_exposure, frame.data());
    return frame;
}

void require_finite(const Gaussians& g) {
    for (int k = 0; k < kNumGroups; ++k) {
        const auto& group = g.groups[k];
        const auto bad =
            std::find_if(group.param.begin(), group.param.end(), [&](float x) { return !has_meaning(Group(k), x); });
        if (bad != group.param.end())
            throw DataError(fmt::format("cannot export: Gaussian {} has {} = {}",
                                        (bad - group.param.begin()) / group.width, kGroupNames[std::size_t(k)], *bad));
    }
    const auto bad =
        std::find_if(g.shared.param.begin(), g.shared.param.end(), [](float x) { return !gs_isfinite(x); });
    if (bad != g.shared.param.end())
        throw DataError(fmt::format("cannot export: shared weight {} is {}", bad - g.shared.param.begin(), *bad));
}

Gaussians visible_gaussians(const Gaussians& g) {
    std::vector<std::int64_t> rows;
    for (std::int64_t i = 0; i < g.count; ++i) {
        const float* q = g[Group::kRotation].param.data() + 4 * i;
        const double norm2 = double(q[0]) * q[0] + double(q[1]) * q[1] + double(q[2]) * q[2] + double(q[3]) * q[3];
        if (sigmoid(double(g[Group::kOpacity].param[std::size_t(i)])) >= kMinAlpha && norm2 >= kMinQuaternionNorm2)
            rows.push_back(i);
    }
    return selected_rows(g, rows);
}

void order_by_importance(Gaussians& g, const std::vector<float>& scores) {
    std::vector<std::int64_t> order(std::size_t(g.count));
    std::iota(order.begin(), order.end(), 0);
    std::vector<double> values(order.size());
    parallel_for_rows(g.count, [&](std::int64_t i) { values[std::size_t(i)] = importance(g, scores, i); });
    const std::int64_t with_residual = g.is_mixed() ? g.num_residuals() : 0;
    order_part(values, order, 0, with_residual);
    order_part(values, order, with_residual, g.count);
    g = selected_rows(g, order);
}

void complete_residuals(Gaussians& g) {
    if (!g.is_mixed()) return;
    const ModelInfo& info = appearance_model(g.appearance.model);
    if (info.num_shared > 0)
        throw UsageError(fmt::format(
            "appearance {}: {} of {} Gaussians have no residual, and with shared weights there is no residual that "
            "changes nothing: only viewers that know mixed models can show them",
            info.name, g.count - g.num_residuals(), g.count));
    GroupArrays<float>& residuals = g[Group::kResidual];
    std::vector<float> row(std::size_t(residuals.width));
    info.init_residual(g.appearance.max_degree, row.data());
    if (info.clear_residual) info.clear_residual(g.appearance.max_degree, row.data());
    for (std::int64_t i = g.num_residuals(); i < g.count; ++i)
        residuals.param.insert(residuals.param.end(), row.begin(), row.end());
}

PackedScene pack_gaussians(const Gaussians& g) {
    const Packing* packing = appearance_model(g.appearance.model).packing;
    if (!packing)
        throw UsageError(
            fmt::format("the appearance '{}' cannot be packed for the viewer; use --format ply", g.appearance.model));
    const double shift = base_shift(g.appearance.activation);
    PackedScene scene;
    scene.antialiased = g.antialiased;
    scene.activation = packed_activation_of(g.appearance.activation);
    scene.appearance = packing->prepare(g);
    parallel_for_rows(scene.appearance.rows, [&](std::int64_t i) { packing->pack_row(g, i, scene.appearance); });
    scene.base_range = find_base_range(g, shift, *packing, scene.appearance);
    scene.geometry.resize(std::size_t(g.count));
    parallel_for_rows(g.count, [&](std::int64_t i) {
        scene.geometry[std::size_t(i)] = encode_geometry(geometry_of(g, i, shift), scene.base_range);
    });
    return scene;
}

PackedScene packed_sample(const AppearanceSpec& appearance) {
    Gaussians one;
    one.count = 1;
    one.appearance = appearance;
    one.active_degree = appearance.max_degree;
    for (int g = 0; g < kNumGroups; ++g) {
        one.groups[g].width = group_width(Group(g), appearance);
        one.groups[g].param.resize(std::size_t(one.groups[g].width));
    }
    one[Group::kRotation].param[0] = 1;
    one.shared.width = appearance_model(appearance.model).num_shared;
    one.shared.param.resize(std::size_t(one.shared.width));
    return pack_gaussians(one);
}

void add_cameras(PackedScene& scene, const Gaussians& g, const std::vector<View>& test) {
    if (g.count == 0 && test.empty()) return;
    const std::vector<float>& means = g[Group::kMean].param;
    const Eigen::Vector3d center = median_center(g);
    std::vector<Camera> cameras;
    std::vector<double> distances;
    for (const View& view : test) {
        scene.cameras.push_back(packed_camera(view.camera));
        cameras.push_back(view.camera);
        distances.push_back((view.camera.center() - center).norm());
    }
    if (test.empty()) {
        for (std::int64_t i = 0; i < g.count; ++i)
            distances.push_back(1.5 * (Eigen::Vector3f(means.data() + 3 * i).cast<double>() - center).norm());
    }
    const Eigen::Vector3d up = find_up(cameras).value_or(-Eigen::Vector3d::UnitY());
    scene.distance = float(median(std::move(distances)));
    scene.center = {float(center.x()), float(center.y()), float(center.z())};
    scene.up = {float(up.x()), float(up.y()), float(up.z())};
}

}  // namespace gs
