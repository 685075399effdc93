// SPDX-License-Identifier: Apache-2.0
// One Gaussian from its stored row to a splat, and from the splat's gradients back to the row: geometry and colour.
#pragma once

#include "appearance/contract.h"
#include "kernels/backend.h"
#include "kernels/blend/blend_device.h"
#include "kernels/preprocess/preprocess_device.h"

namespace gs {

/// Parameters of all Gaussians, row-major, as in GaussianState.
template <class Real> struct ParameterView {
    std::int64_t count;
    const Real *means, *log_scales, *rotations, *raw_opacities, *base_colors, *residuals;
    int residual_width;
    ColorActivation activation;

    static ParameterView of(const GaussianState<Real>& s) {
        const auto p = [&](Group g) { return s[g].param.data(); };
        return {s.count,         p(Group::kMean),     p(Group::kScale),          p(Group::kRotation),     p(Group::kOpacity),
                p(Group::kBase), p(Group::kResidual), s[Group::kResidual].width, s.appearance.activation};
    }
    GS_HD GaussianGeometry<Real> geometry(std::int64_t i) const {
        return {{means[3 * i], means[3 * i + 1], means[3 * i + 2]},
                {log_scales[3 * i], log_scales[3 * i + 1], log_scales[3 * i + 2]},
                {rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]},
                raw_opacities[i]};
    }
    GS_HD Vec3<Real> base(std::int64_t i) const { return {base_colors[3 * i], base_colors[3 * i + 1], base_colors[3 * i + 2]}; }
    GS_HD const Real* residual(std::int64_t i) const { return residuals + i * residual_width; }
};

/// What the backward pass knows about one Gaussian, but for its residual. For an invisible one `visible` is false and all
/// is zero.
template <class Real> struct GaussianGradient {
    bool visible;
    GeometryGradient<Real> geometry;
    Vec3<Real> base;
    Vec2<Real> mean2d; ///< pixels; for the densification statistic
};

template <class Model, class Real> GS_HD Vec3<Real> appearance_residual(const Real* residual, const ViewDirection<Real>& direction, int degree) {
    if constexpr (Model::kDirectional) {
        if (degree > 0) return Model::residual(residual, direction.unit, degree);
    }
    return {Real(0), Real(0), Real(0)};
}

template <class Real> GS_HD Vec3<Real> activate(ColorActivation activation, const Vec3<Real>& y) {
    return {color_activation(activation, y.x), color_activation(activation, y.y), color_activation(activation, y.z)};
}

/// Colour of a Gaussian at `mean`; `residual` is its row, read only where the model has a residual and `degree` > 0.
template <class Model, class Real>
GS_HD Vec3<Real> gaussian_color(ColorActivation activation, const Vec3<Real>& base, const Real* residual, const Vec3<Real>& mean, const Vec3<Real>& camera_position,
                                int degree, RenderMode mode) {
    if (mode == RenderMode::kBaseOnly) return activate(activation, base);
    const Vec3<Real> full = activate(activation, base + appearance_residual<Model>(residual, view_direction(mean, camera_position), degree));
    if (mode == RenderMode::kFull) return full;
    const Vec3<Real> d = full - activate(activation, base);
    return {gs_abs(d.x), gs_abs(d.y), gs_abs(d.z)};
}

/// Conic and opacity of a splat from its projection.
template <class Real> GS_HD void set_shape(Splat<Real>& s, const Projection<Real>& p, Real raw_opacity) {
    const Real inv = Real(1) / p.det;
    s.a = p.cov2d.yy * inv;
    s.b = -p.cov2d.xy * inv;
    s.c = p.cov2d.xx * inv;
    s.opacity = sigmoid(raw_opacity);
}

/// Geometry of the splat, its pixel bounds on a grid padded to whole tiles, and its depth. False: culled. The colour is
/// left out: it is only worth computing once a tile is known to be touched.
template <class Real>
GS_HD bool make_splat(const GaussianGeometry<Real>& g, const CameraParams<Real>& camera, int width_padded, int height_padded, Splat<Real>& s,
                      PixelBounds& bounds, Real& depth) {
    if (!(sigmoid(g.raw_opacity) >= Real(kMinAlpha))) return false;
    Projection<Real> p;
    if (!project_geometry(g, camera, p)) return false;
    set_shape(s, p, g.raw_opacity);
    s.mean = {camera.fx * p.u + camera.cx, camera.fy * p.v + camera.cy};
    s.threshold = gs_max(gs_log(Real(255) * s.opacity), Real(0));
    bounds = pixel_bounds(s.mean, p.cov2d, touch_threshold(s), width_padded, height_padded);
    depth = p.cam.z;
    return bounds.x_max > bounds.x_min && bounds.y_max > bounds.y_min;
}

/// All gradients of one Gaussian from its sums over pixels. `out` must be zeroed; it stays so for a Gaussian that projects
/// to nothing. `residual` and `dL_dresidual` (zeroed by the caller) are rows of the model's width; they may be null
/// without a residual.
template <class Model, class Real>
GS_HD void gaussian_backward(const GaussianGeometry<Real>& g, const Vec3<Real>& base, const Real* residual, ColorActivation activation,
                             const CameraParams<Real>& camera, int degree, const SplatSums<Real>& sums, GaussianGradient<Real>& out, Real* dL_dresidual) {
    Projection<Real> p;
    if (!project_geometry(g, camera, p)) return;
    out.visible = true;
    Splat<Real> splat;
    set_shape(splat, p, g.raw_opacity);
    const SplatGradient<Real> d = splat_gradient(splat, sums);
    out.mean2d = d.mean;
    out.geometry = project_backward(g, camera, p, splat.opacity, d);
    const ViewDirection<Real> direction = view_direction(g.mean, camera.position);
    const Vec3<Real> y = base + appearance_residual<Model>(residual, direction, degree);
    out.base = {color_activation_derivative(activation, y.x) * d.color.x, color_activation_derivative(activation, y.y) * d.color.y,
                color_activation_derivative(activation, y.z) * d.color.z};
    if constexpr (Model::kDirectional) {
        if (degree > 0) {
            Vec3<Real> dL_ddirection;
            Model::residual_backward(residual, direction.unit, degree, out.base, dL_dresidual, dL_ddirection);
            out.geometry.mean += direction_pullback(direction, dL_ddirection);
        }
    }
}

}  // namespace gs
