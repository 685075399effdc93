// SPDX-License-Identifier: Apache-2.0
// The render pipeline on the CPU: preprocess, sort and blend, and the gradients in the reverse order.
//
// It is a template over the scalar (float in production, double as the tests' reference) and the appearance model.
// Results do not depend on the number of threads: parts and tiles have fixed sizes, each instance's gradient has its
// own slot, and sums run in a fixed order.
#pragma once

#include <atomic>
#include <span>
#include <vector>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/blend/blend_cpu.h"
#include "kernels/preprocess/gaussian_device.h"
#include "kernels/preprocess/splat_lanes_cpu.h"
#include "kernels/reference_image.h"
#include "kernels/sort/binning.h"
#include "kernels/splat/depth_key.h"
#include "kernels/splat/projected_view.h"

namespace gs {

/// Adds the time of a scope to a sum.
class StageTimer {
  public:
    explicit StageTimer(double& seconds) : seconds_(seconds), start_(seconds_now()) {}
    ~StageTimer() { seconds_ += seconds_now() - start_; }

  private:
    double& seconds_;
    const double start_;
};

/// The rays of a lens's pixels, kept until another lens is used.
template <class Real> struct LensRays {
    CameraParams<Real> camera{};
    std::vector<Real> planes;  ///< (3,H,W), unit

    void update(const CameraParams<Real>& c) {
        if (!planes.empty() && has_same_rays(camera, c)) return;
        camera = c;
        const std::size_t plane = std::size_t(c.width) * c.height;
        planes.resize(3 * plane);
        parallel_for(c.height, [&](std::int64_t y) {
            for (int x = 0; x < c.width; ++x) {
                const Vec3<Real> ray =
                    lens_ray(c.lens, (Real(x) + Real(0.5) - c.cx) / c.fx, (Real(y) + Real(0.5) - c.cy) / c.fy);
                const std::size_t i = std::size_t(y) * c.width + x;
                planes[i] = ray.x, planes[i + plane] = ray.y, planes[i + 2 * plane] = ray.z;
            }
        });
    }
};

template <class Real, class Model> class CpuRasterizer {
  public:
    explicit CpuRasterizer(std::int64_t max_instances = default_max_instances(), const Cutoffs<Real>& cutoffs = {})
        : max_instances_(max_instances), cutoffs_(cutoffs) {}

    /// Renders a view into image, planar (3,H,W), and transmittance (H,W). Keeps the intermediate results for
    /// backward().
    void forward(const ParameterView<Real>& params, const CameraParams<Real>& camera, const Vec3<Real>& background,
                 int degree, RenderMode mode, Real* image, Real* transmittance) {
        begin_view(camera, background, degree);
        {
            const StageTimer timer(seconds.preprocess);
            const auto view = view_lanes();
            lens_shapes_.resize(camera.lens.is_pinhole() ? 0 : params.count);
            fill_bins(params.count, [&](std::int64_t first, std::int64_t, BinningInput::Part& bin) {
                SplatLanes<Real> s;
                for (unsigned shown = make_splats(params, first, view, s); shown; shown &= shown - 1) {
                    const int lane = __builtin_ctz(shown);
                    const std::int64_t i = first + lane;
                    splats_[i] = s.splat(lane);
                    if (!lens_shapes_.empty()) lens_shapes_[i] = s.lens_shapes[lane];
                    if (!add_instances(i, s.pixel_bounds(lane), s.depth[lane], bin)) continue;
                    splats_[i].color = color_of(params, i, mode);
                }
            });
        }
        sort_and_blend(image, transmittance);
    }

    /// Renders a view of given splats in the same way. The splats replace Gaussians in the kept results.
    void forward(std::span<const WireSplat> splats, const CameraParams<Real>& camera, const Vec3<Real>& background,
                 Real* image, Real* transmittance) {
        begin_view(camera, background, 0);
        {
            const StageTimer timer(seconds.preprocess);
            lens_shapes_.resize(camera.lens.is_pinhole() ? 0 : splats.size());
            fill_bins(std::int64_t(splats.size()), [&](std::int64_t i, std::int64_t end, BinningInput::Part& bin) {
                for (; i < end; ++i) {
                    PixelBounds bounds;
                    splats_[i] = received_splat(splats[i], camera, tiles_x_ * kCpuTile, tiles_y_ * kCpuTile,
                                                cutoffs_.inverse_alpha, bounds,
                                                lens_shapes_.empty() ? nullptr : &lens_shapes_[i]);
                    add_instances(i, bounds, splats[i].depth, bin);
                }
            });
        }
        sort_and_blend(image, transmittance);
    }

    /// Computes the splats of the Gaussians that touch a tile of a view.
    void project(const ParameterView<Real>& params, const CameraParams<Real>& camera, int degree, RenderMode mode,
                 ProjectedView& out) {
        if (std::max(camera.width, camera.height) > kMaxWireSide)
            throw DeviceError("image of " + std::to_string(camera.width) + "x" + std::to_string(camera.height) +
                              " pixels: several ranks take up to " + std::to_string(kMaxWireSide) + " a side");
        begin_view(camera, {}, degree);
        const StageTimer timer(seconds.preprocess);
        const auto view = view_lanes();
        const std::int64_t parts = num_parts(params.count);
        projected_parts_.resize(parts);
        parallel_for(parts, [&](std::int64_t part) {
            ProjectedPart& p = projected_parts_[part];
            std::vector<std::uint32_t> tiles;
            p.splats.clear(), p.rows.clear();
            SplatLanes<Real> lanes;
            for (std::int64_t first = part * kPartSize, end = std::min(params.count, first + kPartSize); first < end;
                 first += kLanes)
                for (unsigned shown = make_splats(params, first, view, lanes); shown; shown &= shown - 1) {
                    const int lane = __builtin_ctz(shown);
                    Splat<Real> s = lanes.splat(lane);
                    tiles.clear();
                    const PixelBounds bounds = lanes.pixel_bounds(lane);
                    if (!add_tiles(s, bounds, tiles_x_, tiles)) continue;
                    s.color = color_of(params, first + lane, mode);
                    p.splats.push_back(camera.lens.is_pinhole()
                                           ? WireSplat::of(s, bounds, lanes.depth[lane])
                                           : WireSplat::of(s, lanes.lens_shapes[lane], lanes.depth[lane]));
                    p.rows.push_back(std::uint32_t(first + lane));
                }
        });
        out.part_ends.clear();
        std::size_t num = 0;
        for (const ProjectedPart& p : projected_parts_) out.part_ends.push_back(num += p.rows.size());
        WireSplat* splats = out.splats.resize(num);
        std::uint32_t* rows = out.rows.resize(num);
        for (const ProjectedPart& p : projected_parts_) {
            splats = std::copy(p.splats.begin(), p.splats.end(), splats);
            rows = std::copy(p.rows.begin(), p.rows.end(), rows);
        }
    }

    /// Computes the blend's gradients of the last forward(), whose mode must be kFull. gaussian_gradient() may be
    /// called afterwards.
    void backward(const Real* image, const Real* transmittance, const Real* dL_dimage) {
        const StageTimer timer(seconds.blend_backward);
        sums_.resize(binning_.instances().size());
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            blend_tile_backward(tile_input(tile), processed_[tile], block_masks_.data() + binning_.offsets()[tile],
                                image, transmittance, dL_dimage, sums_.data());
        });
    }

    struct FullGradient : GaussianGradient<Real> {
        Real residual[Model::kMaxResidual > 0 ? Model::kMaxResidual : 1];

        /// Adds another view's gradient times `share`, with `width` values of the residual.
        void add(const FullGradient& other, Real share, int width) {
            GaussianGradient<Real>::add(other, share);
            for (int k = 0; k < width; ++k) residual[k] += share * other.residual[k];
        }
    };

    /// Returns whether Gaussian i touches a tile in the last forward().
    bool is_visible(std::int64_t i) const { return bins_.count[i] > 0; }

    /// Computes the gradients of Gaussian i, and its part of the camera's if `with_camera` is set, and adds its
    /// gradients of the shared weights. `params` must be the same as in forward(). Thread-safe.
    void gaussian_gradient(const ParameterView<Real>& params, std::int64_t i, bool with_camera, FullGradient& out,
                           Real* dL_dshared) const {
        out = {};
        if (!is_visible(i)) return;
        gaussian_backward<Model>(params, i, camera_, params.degree(i, degree_), sums(i), with_camera,
                                 static_cast<GaussianGradient<Real>&>(out), out.residual, dL_dshared);
    }

    /// Returns the sums of Gaussian i over pixels after backward(); 0 if it touches no tile. Thread-safe.
    SplatSums<Real> sums(std::int64_t i) const {
        SplatSums<Real> sum{};
        if (!is_visible(i)) return sum;
        const SplatSums<Real>* s = &sums_[binning_.part_slots()[i / kPartSize] + bins_.first[i]];
        for (std::uint32_t k = 0; k < bins_.count[i]; ++k) {
            sum.h += s[k].h, sum.hx += s[k].hx, sum.hy += s[k].hy, sum.hxx += s[k].hxx, sum.hxy += s[k].hxy,
                sum.hyy += s[k].hyy;
            sum.r += s[k].r, sum.g += s[k].g, sum.b += s[k].b;
        }
        return sum;
    }

    /// Returns the sum over pixels of dL/dcolour of Gaussian i after backward(); 0 if it touches no tile. Thread-safe.
    Vec3<Real> color_gradient(std::int64_t i) const {
        Vec3<Real> out{0, 0, 0};
        if (!is_visible(i)) return out;
        const SplatSums<Real>* s = &sums_[binning_.part_slots()[i / kPartSize] + bins_.first[i]];
        for (std::uint32_t k = 0; k < bins_.count[i]; ++k) out += Vec3<Real>{s[k].r, s[k].g, s[k].b};
        return out;
    }
    /// Returns the colour of Gaussian i in the last forward(). Undefined if it touches no tile.
    Vec3<Real> color(std::int64_t i) const { return splats_[i].color; }

    /// Adds the scores of the last forward(), whose mode must be kFull, to `scores` (Gaussians).
    void add_scores(const Real* image, const Real* transmittance, std::span<double> scores) {
        score_sums_.resize(binning_.instances().size());
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            score_tile(tile_input(tile), processed_[tile], block_masks_.data() + binning_.offsets()[tile], image,
                       transmittance, score_sums_.data());
        });
        parallel_for_rows(std::int64_t(scores.size()), [&](std::int64_t i) {
            if (!is_visible(i)) return;
            const Real* s = &score_sums_[binning_.part_slots()[i / kPartSize] + bins_.first[i]];
            for (std::uint32_t k = 0; k < bins_.count[i]; ++k) scores[i] += s[k];
        });
    }

    /// Replaces the image of the last forward() by the median colours of its pixels (RenderRequest::median).
    void write_medians(Real* image) const {
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            median_tile(tile_input(tile), processed_[tile], block_masks_.data() + binning_.offsets()[tile], image);
        });
    }

    std::int64_t num_visible() const { return binning_.num_visible(); }
    std::int64_t num_instances() const { return static_cast<std::int64_t>(binning_.instances().size()); }

    /// Returns the number of lane operations (16 pixels x 1 Gaussian) of the last forward(), the unit of the cost
    /// model.
    std::int64_t num_lane_operations() const {
        std::int64_t n = 0;
        for (std::size_t tile = 0; tile < processed_.size(); ++tile)
            for (std::int64_t k = 0; k < processed_[tile]; ++k)
                n += __builtin_popcount(block_masks_[binning_.offsets()[tile] + k]);
        return n;
    }

    /// The time spent so far, for the cost model.
    struct Seconds {
        double preprocess = 0, sort = 0, blend = 0, blend_backward = 0;
    } seconds;

  private:
    void begin_view(const CameraParams<Real>& camera, const Vec3<Real>& background, int degree) {
        camera_ = camera;
        depth_key_ = DepthKey::of(float(camera.near_plane), float(camera.far_plane));
        background_ = background;
        degree_ = Model::kDirectional ? degree : 0;
        if (!camera.lens.is_pinhole()) rays_.update(camera);
        tiles_x_ = (camera.width + kCpuTile - 1) / kCpuTile;
        tiles_y_ = (camera.height + kCpuTile - 1) / kCpuTile;
    }

    void sort_and_blend(Real* image, Real* transmittance) {
        {
            const StageTimer timer(seconds.sort);
            binning_.build(bins_, std::uint32_t(tiles_x_) * tiles_y_, max_instances_);
        }
        const StageTimer timer(seconds.blend);
        block_masks_.resize(binning_.instances().size());
        processed_.resize(std::size_t(tiles_x_) * tiles_y_);
        parallel_for(tiles_x_ * tiles_y_, [&](std::int64_t tile) {
            processed_[tile] =
                blend_tile(tile_input(tile), block_masks_.data() + binning_.offsets()[tile], image, transmittance);
        });
    }

    /// Fills splats_ and bins_ for `count` Gaussians; add(first, end, bin) calls add_instances for the Gaussians of a
    /// batch that may touch a tile.
    template <class Add> void fill_bins(std::int64_t count, Add&& add) {
        const std::int64_t parts = num_parts(count);
        bins_.parts.resize(parts);
        bins_.first.resize(count);
        bins_.count.resize(count);
        splats_.resize(count);
        std::atomic<std::int64_t> instances{0};
        parallel_for(parts, [&](std::int64_t part) {
            BinningInput::Part& bin = bins_.parts[part];
            bin.depth_keys.clear();
            bin.tiles.clear();
            const std::int64_t begin = part * kPartSize, end = std::min(count, begin + kPartSize);
            std::fill(bins_.count.begin() + begin, bins_.count.begin() + end, 0u);
            for (std::int64_t first = begin; first < end; first += kLanes) {
                add(first, std::min(end, first + kLanes), bin);
                // Stops before memory runs out; build() then reports it.
                if (instances.load(std::memory_order_relaxed) + std::int64_t(bin.tiles.size()) > max_instances_) break;
            }
            instances += static_cast<std::int64_t>(bin.tiles.size());
        });
    }

    /// Adds the tiles that splats_[i] touches. Returns whether it touches any.
    bool add_instances(std::int64_t i, const PixelBounds& bounds, Real depth, BinningInput::Part& bin) {
        bins_.first[i] = static_cast<std::uint32_t>(bin.tiles.size());
        bins_.count[i] = add_tiles(splats_[i], bounds, tiles_x_, bin.tiles);
        if (!is_visible(i)) return false;
        bin.depth_keys.push_back(std::uint64_t(depth_key_(float(depth))) << 32 | std::uint32_t(i));
        return true;
    }

    ViewLanes<Real> view_lanes() const {
        return ViewLanes<Real>::of(camera_, tiles_x_ * kCpuTile, tiles_y_ * kCpuTile, cutoffs_);
    }

    Vec3<Real> color_of(const ParameterView<Real>& params, std::int64_t i, RenderMode mode) const {
        const Vec3<Real> direction = params.direction(i, camera_.position).unit;
        const int degree = mode == RenderMode::kBaseOnly ? 0 : params.degree(i, degree_);
        return gaussian_color(params.activation, params.base(i),
                              model_residual<Model>(params.shared, params.residual(i), direction, degree), mode);
    }

    TileInput<Real> tile_input(std::int64_t tile) const {
        const std::uint32_t first = binning_.offsets()[tile], last = binning_.offsets()[tile + 1];
        return {int(tile % tiles_x_) * kCpuTile,
                int(tile / tiles_x_) * kCpuTile,
                camera_.width,
                camera_.height,
                binning_.instances().data() + first,
                std::int64_t(last - first),
                splats_.data(),
                background_,
                cutoffs_,
                camera_.period(),
                lens_shapes_.empty() ? nullptr : lens_shapes_.data(),
                camera_.face_focal(),
                camera_.lens.as_pinholes,
                lens_shapes_.empty() ? nullptr : rays_.planes.data()};
    }

    std::int64_t max_instances_;
    Cutoffs<Real> cutoffs_;
    CameraParams<Real> camera_{};
    DepthKey depth_key_{};
    Vec3<Real> background_{};
    int degree_ = 0, tiles_x_ = 0, tiles_y_ = 0;
    BinningInput bins_;
    TileBinning binning_;
    std::vector<Splat<Real>> splats_;
    std::vector<LensShape<Real>> lens_shapes_;  ///< (Gaussians), through a lens only
    LensRays<Real> rays_;
    struct ProjectedPart {
        std::vector<WireSplat> splats;
        std::vector<std::uint32_t> rows;
    };
    std::vector<ProjectedPart> projected_parts_;  ///< parts of project()
    std::vector<std::uint16_t> block_masks_;
    std::vector<std::int64_t> processed_;
    std::vector<SplatSums<Real>> sums_;
    std::vector<Real> score_sums_;  ///< (slots), only if scores are requested
};

template <class Model> std::vector<double> render_in_double_as(const Gaussians& model, const RenderRequest& request) {
    GaussianState<double> state;
    state.count = model.count, state.appearance = model.appearance, state.active_degree = model.active_degree;
    state.antialiased = model.antialiased;
    const auto widen = [](const GroupArrays<float>& from, GroupArrays<double>& to) {
        to.width = from.width;
        to.param.assign(from.param.begin(), from.param.end());
    };
    for (int g = 0; g < kNumGroups; ++g) widen(model.groups[g], state.groups[g]);
    widen(model.shared, state.shared);
    const CameraParams<float>& c = request.camera;
    const auto camera = converted<double>(c, [](float x) { return double(x); });
    const Vec3<float>& bg = request.background;
    const std::size_t pixels = std::size_t(c.width) * std::size_t(c.height);
    std::vector<double> image(3 * pixels), transmittance(pixels);
    CpuRasterizer<double, Model> raster;
    raster.forward(ParameterView<double>::of(state), camera, {bg.x, bg.y, bg.z}, state.active_degree, request.mode,
                   image.data(), transmittance.data());
    if (request.median) raster.write_medians(image.data());
    return image;
}

}  // namespace gs
