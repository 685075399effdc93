// SPDX-License-Identifier: Apache-2.0
// The render pipeline on the CPU, forward and backward: preprocess, sort, blend and the same way back.
//
// A template over the scalar (float in production, double as the tests' reference) and the appearance model. Results
// do not depend on the number of threads: parts and tiles have fixed sizes, instance gradients have a slot each, and
// sums run in a fixed order.
#pragma once

#include <atomic>
#include <chrono>
#include <cstring>
#include <limits>
#include <vector>

#include "appearance/contract.h"
#include "kernels/backend.h"
#include "kernels/blend/blend_cpu.h"
#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "kernels/preprocess/preprocess_device.h"
#include "kernels/sort/binning.h"

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
    GaussianGeometry<Real> geometry(std::int64_t i) const {
        return {{means[3 * i], means[3 * i + 1], means[3 * i + 2]},
                {log_scales[3 * i], log_scales[3 * i + 1], log_scales[3 * i + 2]},
                {rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]},
                raw_opacities[i]};
    }
    Vec3<Real> base(std::int64_t i) const { return {base_colors[3 * i], base_colors[3 * i + 1], base_colors[3 * i + 2]}; }
    const Real* residual(std::int64_t i) const { return residuals + i * residual_width; }
};

/// Everything the backward pass knows about one Gaussian. For an invisible one `visible` is false and all is zero.
template <class Real, class Model> struct GaussianGradient {
    bool visible;
    GeometryGradient<Real> geometry;
    Vec3<Real> base;
    Real residual[Model::kMaxResidual > 0 ? Model::kMaxResidual : 1];
    Vec2<Real> mean2d; ///< pixels; for the densification statistic
};

/// Adds the time of a scope to a sum.
class StageTimer {
  public:
    explicit StageTimer(double& seconds) : seconds_(seconds), start_(std::chrono::steady_clock::now()) {}
    ~StageTimer() { seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

  private:
    double& seconds_;
    std::chrono::steady_clock::time_point start_;
};

template <class Real, class Model> class CpuRasterizer {
  public:
    explicit CpuRasterizer(std::int64_t max_instances = default_max_instances()) : max_instances_(max_instances) {}

    /// image: planar (3,H,W); transmittance: (H,W). Keeps what backward() needs.
    void forward(const ParameterView<Real>& params, const CameraParams<Real>& camera, const Vec3<Real>& background, int degree,
                 RenderMode mode, Real* image, Real* transmittance) {
        camera_ = camera;
        background_ = background;
        degree_ = Model::kDirectional ? degree : 0;
        tiles_x_ = (camera.width + kCpuTile - 1) / kCpuTile;
        tiles_y_ = (camera.height + kCpuTile - 1) / kCpuTile;
        {
            const StageTimer timer(seconds.preprocess);
            preprocess(params, mode);
        }
        {
            const StageTimer timer(seconds.sort);
            binning_.build(bins_, std::uint32_t(tiles_x_) * tiles_y_, max_instances_);
        }
        const StageTimer timer(seconds.blend);
        block_masks_.resize(binning_.instances().size());
        processed_.resize(std::size_t(tiles_x_) * tiles_y_);
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            processed_[tile] = blend_tile(tile_input(tile), block_masks_.data() + binning_.offsets()[tile], image, transmittance);
        });
    }

    /// Blend backward for the last forward() of RenderMode::kFull; then gaussian_gradient() may be called.
    void backward(const Real* image, const Real* transmittance, const Real* dL_dimage) {
        const StageTimer timer(seconds.blend_backward);
        sums_.resize(binning_.instances().size());
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            blend_tile_backward(tile_input(tile), processed_[tile], block_masks_.data() + binning_.offsets()[tile], image, transmittance,
                                dL_dimage, sums_.data());
        });
    }

    /// Gradients of Gaussian i. `params` are those of forward(). Thread-safe.
    void gaussian_gradient(const ParameterView<Real>& params, std::int64_t i, GaussianGradient<Real, Model>& out) const {
        std::memset(static_cast<void*>(&out), 0, sizeof out);
        Projection<Real> p;
        const GaussianGeometry<Real> g = params.geometry(i);
        if (bins_.count[i] == 0 || !project_geometry(g, camera_, p)) return;
        out.visible = true;
        SplatSums<Real> sum{};
        const SplatSums<Real>* s = &sums_[binning_.part_slots()[i / kPartSize] + bins_.first[i]];
        for (std::uint32_t k = 0; k < bins_.count[i]; ++k) {
            sum.h += s[k].h, sum.hx += s[k].hx, sum.hy += s[k].hy, sum.hxx += s[k].hxx, sum.hxy += s[k].hxy, sum.hyy += s[k].hyy;
            sum.r += s[k].r, sum.g += s[k].g, sum.b += s[k].b;
        }
        const Splat<Real>& splat = splats_[i];
        const SplatGradient<Real> d = splat_gradient(splat, sum);
        out.mean2d = d.mean;
        out.geometry = project_backward(g, camera_, p, splat.opacity, d);

        const ViewDirection<Real> direction = view_direction(g.mean, camera_.position);
        const Vec3<Real> y = params.base(i) + residual(params, i, direction);
        out.base = {color_activation_derivative(params.activation, y.x) * d.color.x,
                    color_activation_derivative(params.activation, y.y) * d.color.y,
                    color_activation_derivative(params.activation, y.z) * d.color.z};
        if constexpr (Model::kDirectional) {
            if (degree_ > 0) {
                Vec3<Real> dL_ddirection;
                Model::residual_backward(params.residual(i), direction.unit, degree_, out.base, out.residual, dL_ddirection);
                out.geometry.mean += direction_pullback(direction, dL_ddirection);
            }
        }
    }

    std::int64_t num_visible() const { return binning_.num_visible(); }
    std::int64_t num_instances() const { return static_cast<std::int64_t>(binning_.instances().size()); }

    /// Lane operations (16 pixels x 1 Gaussian) the last forward() evaluated: the unit of the cost model.
    std::int64_t num_lane_operations() const {
        std::int64_t n = 0;
        for (std::size_t tile = 0; tile < processed_.size(); ++tile)
            for (std::int64_t k = 0; k < processed_[tile]; ++k) n += __builtin_popcount(block_masks_[binning_.offsets()[tile] + k]);
        return n;
    }

    /// Time spent so far, for the cost model.
    struct Seconds {
        double preprocess = 0, sort = 0, blend = 0, blend_backward = 0;
    } seconds;

  private:
    Vec3<Real> residual(const ParameterView<Real>& params, std::int64_t i, const ViewDirection<Real>& direction) const {
        if constexpr (Model::kDirectional) {
            if (degree_ > 0) return Model::residual(params.residual(i), direction.unit, degree_);
        }
        return {Real(0), Real(0), Real(0)};
    }

    Vec3<Real> color(const ParameterView<Real>& params, std::int64_t i, const Vec3<Real>& mean, RenderMode mode) const {
        const auto phi = [&](const Vec3<Real>& y) {
            return Vec3<Real>{color_activation(params.activation, y.x), color_activation(params.activation, y.y),
                              color_activation(params.activation, y.z)};
        };
        const Vec3<Real> base = params.base(i);
        if (mode == RenderMode::kBaseOnly) return phi(base);
        const Vec3<Real> full = phi(base + residual(params, i, view_direction(mean, camera_.position)));
        if (mode == RenderMode::kFull) return full;
        const Vec3<Real> d = full - phi(base);
        return {gs_abs(d.x), gs_abs(d.y), gs_abs(d.z)};
    }

    void preprocess(const ParameterView<Real>& params, RenderMode mode) {
        const std::int64_t parts = num_parts(params.count);
        bins_.parts.resize(parts);
        bins_.first.resize(params.count);
        bins_.count.resize(params.count);
        splats_.resize(params.count);
        std::atomic<std::int64_t> instances{0};
        parallel_for(parts, [&](std::int64_t part) {
            BinningInput::Part& bin = bins_.parts[part];
            bin.depth_keys.clear();
            bin.tiles.clear();
            for (std::int64_t i = part * kPartSize, end = std::min(params.count, i + kPartSize); i < end; ++i) {
                bins_.first[i] = static_cast<std::uint32_t>(bin.tiles.size());
                preprocess_one(params, i, mode, bin);
                bins_.count[i] = static_cast<std::uint32_t>(bin.tiles.size()) - bins_.first[i];
                // Stop before memory runs out; build() then reports it.
                if (bins_.count[i] > 0 && instances.load(std::memory_order_relaxed) + std::int64_t(bin.tiles.size()) > max_instances_) break;
            }
            instances += static_cast<std::int64_t>(bin.tiles.size());
        });
    }

    void preprocess_one(const ParameterView<Real>& params, std::int64_t i, RenderMode mode, BinningInput::Part& bin) {
        const GaussianGeometry<Real> g = params.geometry(i);
        const Real opacity = sigmoid(g.raw_opacity);
        if (!(opacity >= Real(kMinAlpha))) return;
        Projection<Real> p;
        if (!project_geometry(g, camera_, p)) return;
        Splat<Real>& s = splats_[i];
        const Real inv = Real(1) / p.det;
        s.a = p.cov2d.yy * inv;
        s.b = -p.cov2d.xy * inv;
        s.c = p.cov2d.xx * inv;
        s.mean = {camera_.fx * p.u + camera_.cx, camera_.fy * p.v + camera_.cy};
        s.opacity = opacity;
        s.threshold = gs_max(gs_log(Real(255) * opacity), Real(0));
        const PixelBounds b = pixel_bounds(s.mean, p.cov2d, touch_threshold(s), tiles_x_ * kCpuTile, tiles_y_ * kCpuTile);
        const std::size_t before = bin.tiles.size();
        for (int ty = b.y_min / kCpuTile; ty * kCpuTile < b.y_max; ++ty)
            for (int tx = b.x_min / kCpuTile; tx * kCpuTile < b.x_max; ++tx) {
                const Real power = min_power_in_rectangle(s, Real(tx * kCpuTile), Real(ty * kCpuTile), Real(kCpuTile - 1), Real(kCpuTile - 1));
                if (power <= touch_threshold(s)) bin.tiles.push_back(std::uint32_t(ty) * tiles_x_ + tx);
            }
        if (bin.tiles.size() == before) return;
        s.color = color(params, i, g.mean, mode);
        const float depth = float(p.cam.z);
        std::uint32_t bits;
        std::memcpy(&bits, &depth, sizeof bits); // positive floats order like their bits
        bin.depth_keys.push_back(std::uint64_t(bits) << 32 | std::uint32_t(i));
    }

    TileInput<Real> tile_input(std::int64_t tile) const {
        const std::uint32_t first = binning_.offsets()[tile], last = binning_.offsets()[tile + 1];
        return {int(tile % tiles_x_) * kCpuTile, int(tile / tiles_x_) * kCpuTile, camera_.width, camera_.height,
                binning_.instances().data() + first, std::int64_t(last - first), splats_.data(), background_};
    }

    std::int64_t max_instances_;
    CameraParams<Real> camera_{};
    Vec3<Real> background_{};
    int degree_ = 0, tiles_x_ = 0, tiles_y_ = 0;
    BinningInput bins_;
    TileBinning binning_;
    std::vector<Splat<Real>> splats_;
    std::vector<std::uint16_t> block_masks_;
    std::vector<std::int64_t> processed_;
    std::vector<SplatSums<Real>> sums_;
};

}  // namespace gs
