// SPDX-License-Identifier: Apache-2.0
// Small random scenes for the kernel tests, a loss with a known gradient, and a renderer without any tricks.
#pragma once

#include <algorithm>
#include <numeric>
#include <random>

#include "appearance/sh/sh.h"
#include "kernels/engines/cpu_rasterizer.h"

namespace gs::test {

inline CameraParams<double> test_camera(int width, int height) {
    // A general rotation, so that no term of the projection vanishes by symmetry.
    CameraParams<double> c{};
    c.rotation = rotation_matrix(Vec4<double>{0.9, 0.1, -0.2, 0.15});
    c.translation = {0.1, -0.2, 4.0};
    c.position = c.rotation.transposed_times(c.translation) * -1.0;
    c.fx = 0.9 * width, c.fy = 1.1 * width, c.cx = 0.47 * width, c.cy = 0.55 * height;
    c.width = width, c.height = height;
    return c;
}

/// Returns the camera with number k of CameraGradient moved by h.
inline CameraParams<double> moved_camera(CameraParams<double> c, int k, double h) {
    double *const place[] = {&c.position.x, &c.position.y, &c.position.z}, *const lens[] = {&c.fx, &c.fy, &c.cx, &c.cy};
    if (k < 3) *place[k] += h;
    if (k >= 6 && k < 10) *lens[k - 6] += h;
    if (k == 10) c.lens = with_first_coefficient(c.lens, c.lens.distortion[0] + h);
    if (k >= 3 && k < 6) {  // rotation exp([w]x): its rows turn against w
        const Vec3<double> axis{double(k == 3), double(k == 4), double(k == 5)};
        for (Vec3<double>* row : {&c.rotation.r0, &c.rotation.r1, &c.rotation.r2})
            *row = *row * std::cos(h) - cross(axis, *row) * std::sin(h) + axis * (dot(axis, *row) * (1 - std::cos(h)));
    }
    c.translation = c.rotation * c.position * -1.0;
    return c;
}

template <class T, class U> CameraParams<T> cast(const CameraParams<U>& c) {
    return converted<T>(c, [](U x) { return T(x); });
}

template <class T, class U> GaussianState<T> cast(const GaussianState<U>& s) {
    GaussianState<T> o;
    o.count = s.count, o.appearance = s.appearance, o.active_degree = s.active_degree, o.step = s.step;
    o.antialiased = s.antialiased;
    for (int k = 0; k < kNumGroups; ++k) {
        o.groups[k].width = s.groups[k].width;
        o.groups[k].param.assign(s.groups[k].param.begin(), s.groups[k].param.end());
    }
    o.shared.width = s.shared.width;
    o.shared.param.assign(s.shared.param.begin(), s.shared.param.end());
    return o;
}

/// Returns n Gaussians of 0.05 to 1 units size around the point that the test camera looks at.
inline GaussianState<double> random_gaussians(std::int64_t n, int degree, std::uint32_t seed) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> normal;
    const int widths[kNumGroups] = {3, 3, 4, 1, 3, appearance::Sh::num_bases(degree) * 3};
    GaussianState<double> s;
    s.count = n;
    s.active_degree = degree;
    s.appearance.max_degree = degree;
    for (int k = 0; k < kNumGroups; ++k) {
        s.groups[k].width = widths[k];
        s.groups[k].param.resize(n * widths[k]);
        for (double& x : s.groups[k].param) x = normal(rng);
    }
    for (double& x : s[Group::kMean].param) x *= 0.8;
    for (double& x : s[Group::kScale].param) x = -1.5 + 0.7 * x;
    for (double& x : s[Group::kResidual].param) x *= 0.2;
    for (double& x : s[Group::kBase].param) x = 0.3 * std::tanh(x);
    return s;
}

/// Returns the same Gaussians antialiased, each with a 3-D filter of about its own size.
template <class Real> GaussianState<Real> antialiased(GaussianState<Real> s) {
    s.antialiased = true;
    s[Group::kSmoothing].width = 1;
    for (std::int64_t i = 0; i < s.count; ++i)
        s[Group::kSmoothing].param.push_back(Real(std::exp(2 * (-1.6 + 0.5 * std::sin(double(i))))));
    return s;
}

/// Computes the image and the gradients of sum(weights * image).
template <class Real, class Model> struct Pipeline {
    CpuRasterizer<Real, Model> raster;
    std::vector<Real> image, transmittance;
    double of_camera[CameraGradient<Real>::kSize];  ///< written by gradients()

    void render(const GaussianState<Real>& s, const CameraParams<Real>& camera, const Vec3<Real>& background,
                RenderMode mode = RenderMode::kFull) {
        image.assign(3 * std::size_t(camera.width) * camera.height, Real(0));
        transmittance.assign(std::size_t(camera.width) * camera.height, Real(0));
        raster.forward(ParameterView<Real>::of(s), camera, background, s.active_degree, mode, image.data(),
                       transmittance.data());
    }
    Real weighted_sum(const std::vector<Real>& weights) const {
        return std::inner_product(image.begin(), image.end(), weights.begin(), Real(0));
    }

    /// Returns the gradients in the layout of GaussianState.
    GaussianState<Real> gradients(const GaussianState<Real>& s, const std::vector<Real>& dL_dimage) {
        raster.backward(image.data(), transmittance.data(), dL_dimage.data());
        GaussianState<Real> out = s;
        const auto params = ParameterView<Real>::of(s);
        for (auto* values : {&out.shared.param, &out[Group::kSmoothing].param})
            std::fill(values->begin(), values->end(), Real(0));
        std::fill(std::begin(of_camera), std::end(of_camera), 0.0);
        for (std::int64_t i = 0; i < s.count; ++i) {
            typename CpuRasterizer<Real, Model>::FullGradient g;
            raster.gaussian_gradient(params, i, true, g, out.shared.param.data());
            g.of_camera().for_each([&](int k, Real number) { of_camera[k] += double(number); });
            const auto put = [&](Group group, std::initializer_list<Real> values) {
                std::copy(values.begin(), values.end(), out[group].param.begin() + i * std::int64_t(values.size()));
            };
            put(Group::kMean, {g.geometry.mean.x, g.geometry.mean.y, g.geometry.mean.z});
            put(Group::kScale, {g.geometry.log_scale.x, g.geometry.log_scale.y, g.geometry.log_scale.z});
            put(Group::kRotation,
                {g.geometry.rotation.x, g.geometry.rotation.y, g.geometry.rotation.z, g.geometry.rotation.w});
            put(Group::kOpacity, {g.geometry.raw_opacity});
            put(Group::kBase, {g.base.x, g.base.y, g.base.z});
            const int w = s[Group::kResidual].width;
            std::copy_n(g.residual, w, out[Group::kResidual].param.begin() + i * w);
        }
        return out;
    }
};

inline std::vector<double> random_weights(std::size_t n, std::uint32_t seed) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(-1, 1);
    std::vector<double> w(n);
    for (double& x : w) x = u(rng);
    return w;
}

/// One pixel of a renderer without tiles and, on request, without truncation.
struct BruteForcePixel {
    Vec3<double> color;
    Vec3<double> median{0, 0, 0};     ///< colour of the Gaussian at which T falls to 1/2 or below; 0 without one
    double transmittance = 1;         ///< of all Gaussians
    double half_distance = 1e9;       ///< nearest distance of a T to 1/2
    double dropped_alpha = 0;         ///< sum of alphas below 1/255
    double threshold_distance = 1e9;  ///< nearest relative distance of an alpha to 1/255 or of T to 1e-4
};

/// An amount that is added to the value of one Gaussian at a pixel.
struct Bump {
    std::int64_t gaussian = -1;
    double value = 0;
};

/// Blends all Gaussians at every pixel in depth order, in double, straight from the definitions.
class BruteForce {
  public:
    BruteForce(const GaussianState<double>& s, const CameraParams<double>& camera) {
        for (std::int64_t i = 0; i < s.count; ++i) {
            const double* m = &s[Group::kMean].param[3 * i];
            const double* q = &s[Group::kRotation].param[4 * i];
            const double* l = &s[Group::kScale].param[3 * i];
            const Vec3<double> p = camera.rotation * Vec3<double>{m[0], m[1], m[2]} + camera.translation;
            if (p.z < camera.near_plane || p.z > camera.far_plane) continue;
            // Rotation from the normalised quaternion by the sandwich product's textbook matrix.
            const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
            const double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
            const double r[3][3] = {{w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                    {2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)},
                                    {2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z}};
            const Vec3<double> rows[3] = {camera.rotation.r0, camera.rotation.r1, camera.rotation.r2};
            const double u = std::clamp(p.x / p.z, (-0.15 * camera.width - camera.cx) / camera.fx,
                                        (1.15 * camera.width - camera.cx) / camera.fx);
            const double v = std::clamp(p.y / p.z, (-0.15 * camera.height - camera.cy) / camera.fy,
                                        (1.15 * camera.height - camera.cy) / camera.fy);
            double cov[2][2] = {};
            for (int k = 0; k < 3; ++k) {  // one principal axis at a time: cov += (J W r_k s_k)(...)^T
                const Vec3<double> axis = Vec3<double>{r[0][k], r[1][k], r[2][k]} * std::exp(l[k]);
                const double cx = dot(rows[0], axis), cy = dot(rows[1], axis), cz = dot(rows[2], axis);
                const double jx = camera.fx / p.z * (cx - u * cz), jy = camera.fy / p.z * (cy - v * cz);
                cov[0][0] += jx * jx, cov[0][1] += jx * jy, cov[1][1] += jy * jy;
            }
            cov[0][0] += 0.3, cov[1][1] += 0.3;
            const double det = cov[0][0] * cov[1][1] - cov[0][1] * cov[0][1];
            Item item{p.z,
                      camera.fx * p.x / p.z + camera.cx,
                      camera.fy * p.y / p.z + camera.cy,
                      cov[1][1] / det,
                      -cov[0][1] / det,
                      cov[0][0] / det,
                      1 / (1 + std::exp(-s[Group::kOpacity].param[i])),
                      {},
                      i};
            const Vec3<double> d = Vec3<double>{m[0], m[1], m[2]} - camera.position;
            const Vec3<double> res =
                appearance::Sh::residual(s[Group::kResidual].param.data() + i * s[Group::kResidual].width,
                                         d * (1 / std::sqrt(dot(d, d))), s.active_degree);
            const double* b = &s[Group::kBase].param[3 * i];
            item.color = {std::max(b[0] + res.x + 0.5, 0.0), std::max(b[1] + res.y + 0.5, 0.0),
                          std::max(b[2] + res.z + 0.5, 0.0)};
            max_color_ = std::max({max_color_, item.color.x, item.color.y, item.color.z});
            items_.push_back(item);
        }
        std::stable_sort(items_.begin(), items_.end(), [](const Item& a, const Item& b) { return a.depth < b.depth; });
    }

    BruteForcePixel pixel(int px, int py, const Vec3<double>& background, bool truncate, Bump bump = {}) const {
        BruteForcePixel out{{0, 0, 0}};
        double t = 1;
        for (const Item& s : items_) {
            const double dx = s.x - (px + 0.5), dy = s.y - (py + 0.5);
            double value = std::exp(-0.5 * (s.a * dx * dx + s.c * dy * dy) - s.b * dx * dy);
            if (s.gaussian == bump.gaussian) value += bump.value;
            const double alpha = s.opacity * value;
            out.threshold_distance = std::min(out.threshold_distance, std::abs(alpha * 255 - 1));
            if (alpha < 1.0 / 255) {
                out.dropped_alpha += alpha;
                if (truncate) continue;
            }
            out.color += s.color * (t * alpha);
            if (t > 0.5 && t * (1 - alpha) <= 0.5) out.median = s.color;
            t *= 1 - alpha;
            out.half_distance = std::min(out.half_distance, std::abs(t - 0.5));
            out.threshold_distance = std::min(out.threshold_distance, std::abs(t * 1e4 - 1));
            if (truncate && t < 1e-4) break;
        }
        out.color += background * t;
        out.transmittance = t;
        return out;
    }
    double max_color() const { return max_color_; }

  private:
    struct Item {
        double depth, x, y, a, b, c, opacity;
        Vec3<double> color;
        std::int64_t gaussian;
    };
    std::vector<Item> items_;
    double max_color_ = 0;
};

}  // namespace gs::test
