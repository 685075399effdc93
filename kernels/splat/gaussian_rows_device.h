// SPDX-License-Identifier: Apache-2.0
// The rows that store Gaussians, and the gradient of one row.
#pragma once

#include "appearance/contract.h"
#include "kernels/splat/projection_device.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// The parameters of all Gaussians, row-major, as in GaussianState.
template <class Real> struct ParameterView {
    std::int64_t count;
    const Real *means, *log_scales, *rotations, *raw_opacities, *base_colors, *residuals;
    int residual_width;
    std::int64_t num_residuals;  ///< number of leading Gaussians with a residual; others have a view-independent colour
    ColorActivation activation;
    const Real* shared;     ///< weights common to all Gaussians, or null
    const Real* smoothing;  ///< (N), variance of the 3-D filter, or null
    bool antialiased;

    static ParameterView of(const GaussianState<Real>& s) {
        const auto p = [&](Group g) { return s[g].param.data(); };
        return {s.count,
                p(Group::kMean),
                p(Group::kScale),
                p(Group::kRotation),
                p(Group::kOpacity),
                p(Group::kBase),
                p(Group::kResidual),
                s[Group::kResidual].width,
                s.num_residuals(),
                s.appearance.activation,
                s.shared.param.data(),
                s[Group::kSmoothing].width > 0 ? p(Group::kSmoothing) : nullptr,
                s.antialiased};
    }
    GS_HD GaussianGeometry<Real> geometry(std::int64_t i) const {
        return {mean(i),
                {log_scales[3 * i], log_scales[3 * i + 1], log_scales[3 * i + 2]},
                {rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]},
                raw_opacities[i],
                smoothing ? smoothing[i] : Real(0),
                antialiased};
    }
    GS_HD Vec3<Real> mean(std::int64_t i) const { return {means[3 * i], means[3 * i + 1], means[3 * i + 2]}; }
    GS_HD ViewDirection<Real> direction(std::int64_t i, const Vec3<Real>& camera_position) const {
        return view_direction(mean(i), camera_position);
    }
    GS_HD Vec3<Real> base(std::int64_t i) const {
        return {base_colors[3 * i], base_colors[3 * i + 1], base_colors[3 * i + 2]};
    }
    GS_HD const Real* residual(std::int64_t i) const { return residuals + i * residual_width; }
    /// Returns the degree of Gaussian i in a view of degree `active`: 0 if the Gaussian has no residual.
    GS_HD int degree(std::int64_t i, int active) const { return i < num_residuals ? active : 0; }
};

/// The gradients of one Gaussian, except those of its residual. For an invisible Gaussian `visible` is false and all
/// other fields are zero.
template <class Real> struct GaussianGradient {
    bool visible;
    GeometryGradient<Real> geometry;
    Vec3<Real> base;
    Vec2<Real> mean2d;  ///< gradient of the mean in pixels, for the densification statistic

    /// Returns the Gaussian's part of the gradient of the camera.
    GS_HD CameraGradient<Real> of_camera() const {
        CameraGradient<Real> out = geometry.camera;
        out.position = geometry.mean * Real(-1);  // all that a view shows depends on the mean minus the position
        return out;
    }

    /// Adds the gradient of another view times `share`. mean2d and the camera's gradient belong to one view, and are
    /// left unchanged.
    GS_HD void add(const GaussianGradient& other, Real share) {
        visible |= other.visible;
        const auto& o = other.geometry;
        geometry.mean += o.mean * share;
        geometry.log_scale += o.log_scale * share;
        geometry.rotation.x += share * o.rotation.x, geometry.rotation.y += share * o.rotation.y;
        geometry.rotation.z += share * o.rotation.z, geometry.rotation.w += share * o.rotation.w;
        geometry.raw_opacity += share * o.raw_opacity;
        base += other.base * share;
    }
};

}  // namespace gs
