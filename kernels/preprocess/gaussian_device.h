// SPDX-License-Identifier: Apache-2.0
// The geometry and colour of one Gaussian: from its stored row to a splat, and from the splat's gradients to the row's
// gradients.
#pragma once

#include "appearance/contract.h"
#include "kernels/requests.h"
#include "kernels/splat/gaussian_rows_device.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

template <class Real> GS_HD bool is_finite(const Vec3<Real>& v) {
    return gs_isfinite(v.x) && gs_isfinite(v.y) && gs_isfinite(v.z);
}

/// Returns the colour of a Gaussian from its base colour and its residual.
template <class Real>
GS_HD Vec3<Real> gaussian_color(ColorActivation activation, const Vec3<Real>& base, const Vec3<Real>& residual,
                                RenderMode mode) {
    if (mode == RenderMode::kBaseOnly) return activate(activation, base);
    const Vec3<Real> full = activate(activation, base + residual);
    if (mode == RenderMode::kFull) return full;
    const Vec3<Real> d = full - activate(activation, base);
    return {gs_abs(d.x), gs_abs(d.y), gs_abs(d.z)};
}

/// Returns dL/dy from dL/dcolour, where y = base + residual. It equals the gradients of the base colour and of the
/// residual.
template <class Real>
GS_HD Vec3<Real> color_backward(ColorActivation activation, const Vec3<Real>& base, const Vec3<Real>& residual,
                                const Vec3<Real>& dL_dcolor) {
    const Vec3<Real> y = base + residual;
    return {color_activation_derivative(activation, y.x) * dL_dcolor.x,
            color_activation_derivative(activation, y.y) * dL_dcolor.y,
            color_activation_derivative(activation, y.z) * dL_dcolor.z};
}

/// Sets the conic and opacity of a splat from its projection.
template <class Real> GS_HD void set_shape(Splat<Real>& s, const Projection<Real>& p, const GaussianGeometry<Real>& g) {
    const Real inv = Real(1) / p.det;
    s.a = p.cov2d.yy * inv;
    s.b = -p.cov2d.xy * inv;
    s.c = p.cov2d.xx * inv;
    s.opacity = sigmoid(g.raw_opacity);
    if (g.antialiased) s.opacity = s.opacity * p.compensation;
}

/// Sets mean and conic of a splat through a lens, and its covariance, to those of its outline on screen. Completes its
/// shape, of which the mean and the conic are given.
template <class Real>
GS_HD void set_outline(Splat<Real>& s, const CameraParams<Real>& camera, Projection<Real>& p, LensShape<Real>& shape) {
    const Real sign(sign_of(p.face)), forward = sign / camera.face_focal();
    const Vec2<Real> mean{camera.fx * p.at.x.value + camera.cx, camera.fy * p.at.y.value + camera.cy};
    const Outline<Real> outline = lens_outline(camera, p, mean, touch_threshold(s));
    shape.forward = {forward * p.u, forward * p.v, sign}, shape.axis = axis_of(p.face), shape.wide = outline.wide;
    s.mean = outline.center, p.cov2d = outline.cov2d;
    p.det = p.cov2d.xx * p.cov2d.yy - p.cov2d.xy * p.cov2d.xy;
    const Real inverse = Real(1) / p.det;
    s.a = p.cov2d.yy * inverse, s.b = -(p.cov2d.xy * inverse), s.c = p.cov2d.xx * inverse;
}

/// Returns the bounds of a splat from the covariance on screen of what it may reach.
template <class Real>
GS_HD PixelBounds splat_bounds(const Splat<Real>& s, const Sym2<Real>& cov2d, const CameraParams<Real>& camera,
                               int width_padded, int height_padded) {
    return camera.lens.wraps()
               ? wrapped_bounds(s.mean, cov2d, touch_threshold(s), camera.width, width_padded, height_padded)
               : pixel_bounds(s.mean, cov2d, touch_threshold(s), width_padded, height_padded);
}

/// Returns a sent splat, and its bounds. Through a lens, writes its shape to `lens_shape` and returns its outline on
/// screen, as make_splat() does.
GS_HD Splat<float> received_splat(const WireSplat& wire, const CameraParams<float>& camera, int width_padded,
                                  int height_padded, float inverse_alpha, PixelBounds& bounds,
                                  LensShape<float>* lens_shape) {
    Splat<float> s = wire.splat(inverse_alpha);
    if (camera.lens.is_pinhole()) {
        bounds = wire.bounds(width_padded, height_padded);
        return s;
    }
    *lens_shape = wire.lens_shape();
    lens_shape->unscale(s);
    Projection<float> p;
    const float unit = 1 / camera.face_focal();
    place_on_face(camera, wire.face(), wire.mean_x * unit, wire.mean_y * unit, p);
    // ac - b^2 cancels for needles, so the rounding error of b^2 is added back.
    const float b2 = s.b * s.b, det = gs_fma(s.a, s.c, -b2) + gs_fma(-s.b, s.b, b2);
    p.det = 1 / gs_max(det, 1e-7f * s.a * s.c);
    p.cov2d = {s.c * p.det, -s.b * p.det, s.a * p.det};
    set_outline(s, camera, p, *lens_shape);
    bounds = splat_bounds(s, p.cov2d, camera, width_padded, height_padded);
    return s;
}

/// Computes the geometry of the splat, its pixel bounds on a grid padded to whole tiles, and its depth. Returns false
/// if the Gaussian is culled. Leaves out the colour, which is only worth computing once the Gaussian is known to touch
/// a tile. Through a lens, writes the shape to `lens_shape`, and the splat holds its outline on screen.
template <class Real>
GS_HD bool make_splat(const GaussianGeometry<Real>& g, const CameraParams<Real>& camera, int width_padded,
                      int height_padded, Splat<Real>& s, PixelBounds& bounds, Real& depth, const Cutoffs<Real>& cutoffs,
                      LensShape<Real>* lens_shape) {
    if (!(sigmoid(g.raw_opacity) >= cutoffs.alpha)) return false;
    Projection<Real> p;
    if (!project_geometry(g, camera, p)) return false;
    depth = p.depth;
    set_shape(s, p, g);
    if (g.antialiased && !(s.opacity >= cutoffs.alpha)) return false;
    s.threshold = splat_threshold(s.opacity, cutoffs.inverse_alpha);
    if (camera.lens.is_pinhole()) {
        s.mean = {camera.fx * p.u + camera.cx, camera.fy * p.v + camera.cy};
    } else {
        const Real focal = camera.face_focal();
        *lens_shape = LensShape<Real>::scaled({focal * p.u, focal * p.v}, s);
        set_outline(s, camera, p, *lens_shape);
    }
    bounds = splat_bounds(s, p.cov2d, camera, width_padded, height_padded);
    return bounds.x_max > bounds.x_min && bounds.y_max > bounds.y_min;
}

/// Computes the gradients of one Gaussian's geometry from its sums over pixels, and its part of the camera's if
/// `with_camera` is set. `out` must be zeroed; it stays zero for a culled Gaussian.
template <class Real>
GS_HD void geometry_backward(const GaussianGeometry<Real>& g, const CameraParams<Real>& camera,
                             const SplatSums<Real>& sums, bool with_camera, GaussianGradient<Real>& out) {
    Projection<Real> p;
    if (!project_geometry(g, camera, p)) return;
    out.visible = true;
    Splat<Real> splat;
    set_shape(splat, p, g);
    const SplatGradient<Real> d = splat_gradient(splat, sums);
    out.mean2d = mean_on_screen_backward(camera, p, d.mean);
    out.geometry = project_backward(g, camera, p, splat.opacity, d, with_camera);
}

/// Computes all gradients of Gaussian i, which must be visible, and its part of the camera's if `with_camera` is set.
/// `out` and `dL_dresidual` (of the model's width) must be zeroed. Adds to `dL_dshared`.
template <class Model, class Real>
GS_HD void gaussian_backward(const ParameterView<Real>& params, std::int64_t i, const CameraParams<Real>& camera,
                             int degree, const SplatSums<Real>& sums, bool with_camera, GaussianGradient<Real>& out,
                             Real* dL_dresidual, Real* dL_dshared) {
    geometry_backward(params.geometry(i), camera, sums, with_camera, out);
    const ViewDirection<Real> direction = params.direction(i, camera.position);
    const Vec3<Real> residual = model_residual<Model>(params.shared, params.residual(i), direction.unit, degree);
    out.base = color_backward(params.activation, params.base(i), residual, {sums.r, sums.g, sums.b});
    if (!is_finite(out.base)) return;  // this Gaussian's gradient is dropped; it must not reach the shared weights
    Vec3<Real> dL_ddirection;
    model_residual_backward<Model>(params.shared, params.residual(i), direction.unit, degree, out.base, dL_dresidual,
                                   dL_ddirection, dL_dshared);
    out.geometry.mean += direction_pullback(direction, dL_ddirection);
}

}  // namespace gs
