// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/reference.h"

#include <atomic>
#include <numeric>

#include "appearance/none/none.h"
#include "kernels/loss/loss.h"
#include "kernels/loss/loss_device.h"
#include "tests/gpu/noisy.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

/// Returns a value that float holds exactly.
template <class Real> Real exact(double x) {
    if constexpr (std::is_same_v<Real, Rounded>)
        return {x, 0};
    else
        return Real(x);
}

/// Returns a coordinate of a pixel's ray, which the device finds to a few roundings.
template <class Real> Real ray_coordinate(double x) {
    if constexpr (std::is_same_v<Real, Rounded>)
        return {x, 8 * kRoundoff};
    else
        return Noisy::of(x, 4);
}

template <class Real> CameraParams<Real> camera_of(const CameraParams<float>& c) {
    return converted<Real>(c, [](float x) { return exact<Real>(x); });
}

constexpr int kTile = 32;  ///< the reference's tile, a whole number of the device's sub-tiles
constexpr int kSubX = 8, kSubY = 4;

/// All Gaussians as splats, and for each tile those that may reach it, front to back.
template <class Model, class Real> struct Projected {
    const Gaussians& model;
    CameraParams<Real> camera;
    Vec3<Real> background;
    int width, height, degree, tiles_x, tiles_y;
    std::array<std::vector<Real>, kNumGroups> params;
    std::vector<Real> shared;
    std::vector<Splat<Real>> splats;
    std::vector<LensShape<Real>> lens_shapes;  ///< through a lens only
    std::vector<Vec3<double>> rays;            ///< of the pixels, through a lens only
    std::vector<char> visible;
    std::vector<std::vector<std::uint32_t>> lists;

    Projected(const Gaussians& m, const CameraParams<float>& c, const Vec3<float>& bg, RenderMode mode,
              std::uint64_t sample)
        : model(m),
          camera(camera_of<Real>(c)),
          background{exact<Real>(bg.x), exact<Real>(bg.y), exact<Real>(bg.z)},
          width(c.width),
          height(c.height),
          degree(Model::kDirectional ? m.active_degree : 0),
          tiles_x((width + kTile - 1) / kTile),
          tiles_y((height + kTile - 1) / kTile) {
        for (int g = 0; g < kNumGroups; ++g) {
            params[g].reserve(m.groups[g].param.size());
            for (const float x : m.groups[g].param) params[g].push_back(exact<Real>(x));
        }
        for (const float x : m.shared.param) shared.push_back(exact<Real>(x));
        const std::int64_t n = m.count;
        if (!camera.lens.is_pinhole()) {
            lens_shapes.resize(n);
            const auto exactly = converted<double>(c, [](float x) { return double(x); });
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x)
                    rays.push_back(lens_ray(exactly.lens, (x + 0.5 - exactly.cx) / exactly.fx,
                                            (y + 0.5 - exactly.cy) / exactly.fy));
        }
        splats.resize(n), visible.assign(n, 0), lists.resize(std::size_t(tiles_x) * tiles_y);
        std::vector<PixelBounds> bounds(n);
        std::vector<std::uint64_t> keys(n), order;
        const DepthKey key = DepthKey::of(c.near_plane, c.far_plane);
        parallel_for_rows(n, [&](std::int64_t i) {
            Noise::start(sample, std::uint64_t(i));
            Real depth{};
            LensShape<Real> lens_shape;
            visible[i] = make_splat(geometry(i), camera, tiles_x * kTile, tiles_y * kTile, splats[i], bounds[i], depth,
                                    {}, &lens_shape);
            if (!lens_shapes.empty()) lens_shapes[i] = lens_shape;
            if (!visible[i]) return;
            splats[i].color =
                gaussian_color(model.appearance.activation, row3(Group::kBase, i),
                               model_residual<Model>(view().shared, view().residual(i),
                                                     view_direction(row3(Group::kMean, i), camera.position).unit,
                                                     mode == RenderMode::kBaseOnly ? 0 : degree),
                               mode);
            keys[i] = std::uint64_t(key(float(depth.v))) << 32 | std::uint64_t(i);
        });
        for (std::int64_t i = 0; i < n; ++i)
            if (visible[i]) order.push_back(keys[i]);
        std::sort(order.begin(), order.end());
        for (const std::uint64_t k : order) {
            const std::uint32_t i = std::uint32_t(k);
            const PixelBounds& b = bounds[i];  // a pixel more on every side: rounding may move them
            for (int ty = std::max(b.y_min - 1, 0) / kTile; ty < tiles_y && ty * kTile < b.y_max + 1; ++ty)
                for (int tx = 0; tx < tiles_x; ++tx)
                    if (camera.lens.wraps() || (b.x_min - 1 < (tx + 1) * kTile && tx * kTile < b.x_max + 1))
                        lists[ty * tiles_x + tx].push_back(i);
        }
    }
    Vec3<Real> row3(Group g, std::int64_t i) const {
        const Real* p = params[int(g)].data() + 3 * i;
        return {p[0], p[1], p[2]};
    }
    ParameterView<Real> view() const {
        const auto p = [&](Group g) { return params[int(g)].data(); };
        return {model.count,           p(Group::kMean),
                p(Group::kScale),      p(Group::kRotation),
                p(Group::kOpacity),    p(Group::kBase),
                p(Group::kResidual),   model[Group::kResidual].width,
                model.num_residuals(), model.appearance.activation,
                shared.data(),         filtered() ? p(Group::kSmoothing) : nullptr,
                model.antialiased};
    }
    GaussianGeometry<Real> geometry(std::int64_t i) const {
        const Real* q = params[int(Group::kRotation)].data() + 4 * i;
        return {row3(Group::kMean, i),
                row3(Group::kScale, i),
                {q[0], q[1], q[2], q[3]},
                params[int(Group::kOpacity)][i],
                filtered() ? params[int(Group::kSmoothing)][i] : Real(0),
                model.antialiased};
    }
    bool filtered() const { return model[Group::kSmoothing].width > 0; }
    /// Returns whether a splat is too far to reach the pixel, as most of a tile are. The error of alpha is nowhere near
    /// a factor of 16.
    bool far(std::uint32_t i, int x, int y) const {
        const Splat<Real>& s = splats[i];
        if (!lens_shapes.empty()) return fragment(i, x, y).alpha.v < kMinAlpha / 16;
        const double dx = s.mean.x.v - (x + 0.5), dy = s.mean.y.v - (y + 0.5);
        return s.opacity.v * std::exp(-0.5 * (s.a.v * dx * dx + s.c.v * dy * dy) - s.b.v * dx * dy) < kMinAlpha / 16;
    }
    LensFragment<Real> fragment(std::uint32_t i, int x, int y) const {
        const Splat<Real>& s = splats[i];
        if (!lens_shapes.empty()) {
            const Vec3<double>& d = rays[std::size_t(y) * width + x];
            const LensShape<Real>& shape = lens_shapes[i];
            const FaceRay<Real> ray =
                face_ray(Vec3<Real>{ray_coordinate<Real>(d.x), ray_coordinate<Real>(d.y), ray_coordinate<Real>(d.z)},
                         shape.axis, camera.face_focal(), camera.lens.as_pinholes);
            return lens_fragment_alpha<Real>(shape, s.opacity, ray);
        }
        return {fragment_alpha(FragmentShape<Real>::from(s), exact<Real>(x + 0.5), exact<Real>(y + 0.5)),
                exact<Real>(1)};
    }
    template <class Pixel> void for_pixels(int tile, Pixel&& pixel) const {
        const int x0 = tile % tiles_x * kTile, y0 = tile / tiles_x * kTile;
        for (int y = y0; y < std::min(y0 + kTile, height); ++y)
            for (int x = x0; x < std::min(x0 + kTile, width); ++x) pixel(x, y);
    }
};

// --- images: bounds --------------------------------------------------------------------------------------------------

bool may_be_at_least(Rounded x, double threshold) { return x.v + x.e + kRoundoff * threshold >= threshold; }
bool certain(Rounded x, double threshold) { return std::abs(x.v - threshold) > x.e + kRoundoff * threshold; }

template <class Model> RenderReference bounded_render(const Gaussians& model, const RenderRequest& r) {
    const Projected<Model, Rounded> scene(model, r.camera, r.background, r.mode, 0);
    const std::size_t plane = std::size_t(scene.width) * scene.height;
    RenderReference out;
    out.rgb.resize(3 * plane), out.alpha.resize(plane), out.seen.assign(model.count, 0);
    std::vector<std::int64_t> undecided(scene.lists.size());
    parallel_for(std::int64_t(scene.lists.size()), [&](std::int64_t tile) {
        scene.for_pixels(int(tile), [&](int x, int y) {
            PixelForward<Rounded> p{{1, 0}, {0, 0}, {0, 0}, {0, 0}};
            bool either = false;
            for (const std::uint32_t i : scene.lists[tile]) {
                if (!may_be_at_least(p.t, kMinTransmittance)) break;
                const Splat<Rounded>& s = scene.splats[i];
                if (scene.far(i, x, y)) continue;
                const Rounded alpha = scene.fragment(i, x, y).alpha;
                if (!may_be_at_least(alpha, kMinAlpha)) continue;
                const bool sure = certain(alpha, kMinAlpha) && certain(p.t, kMinTransmittance);
                const double w = p.t.v * alpha.v;
                blend_fragment<Rounded, Rounded>(p, alpha, s.color.x, s.color.y, s.color.z);
                if (sure) {
                    std::atomic_ref<char>(out.seen[i]).store(1, std::memory_order_relaxed);
                    continue;
                }
                either = true;
                p.t.e += w, p.r.e += w * s.color.x.v, p.g.e += w * s.color.y.v, p.b.e += w * s.color.z.v;
            }
            undecided[tile] += either;
            const std::size_t at = std::size_t(y) * scene.width + x;
            out.rgb[at] = p.r + p.t * scene.background.x, out.rgb[at + plane] = p.g + p.t * scene.background.y;
            out.rgb[at + 2 * plane] = p.b + p.t * scene.background.z;
            out.alpha[at] = Rounded{1, 0} - p.t;
        });
    });
    out.undecided_pixels = std::accumulate(undecided.begin(), undecided.end(), std::int64_t(0));
    // The values are the double backend's; they must be those that the bounds belong to.
    Pipeline<double, Model> pipe;
    pipe.render(cast<double>(model), cast<double>(r.camera), {r.background.x, r.background.y, r.background.z}, r.mode);
    const auto take = [](Rounded& to, double value) {
        if (!(std::abs(to.v - value) <= 1e-9))
            throw std::logic_error("two evaluations in double differ: " + std::to_string(to.v) + " and " +
                                   std::to_string(value));
        to.v = value;
    };
    for (std::size_t i = 0; i < 3 * plane; ++i) take(out.rgb[i], pipe.image[i]);
    for (std::size_t i = 0; i < plane; ++i) take(out.alpha[i], 1 - pipe.transmittance[i]);
    return out;
}

// --- gradients: samples ----------------------------------------------------------------------------------------------

/// A sum over the pixels of a sub-tile, with the sum of magnitudes.
struct Sum {
    double v = 0, size = 0;
    void add(double term, double magnitude) { v += term, size += magnitude; }
};

/// The roundings of a sum over a sub-tile, relative to the sum of magnitudes: those of four products and their sum over
/// a column (4 u), of moments moved from the middle of the column to the mean (4 u), and of the sum over eight columns
/// (7 u).
constexpr double kSumUnits = 4 + 4 + 7;
/// The middle of a column is at most 1.5 pixels from one of its own. Both the mean's distance from it and the pixel's
/// are factors of what cancels.
constexpr double kMomentShift = 3;
double noise_of_sum(const Sum& s) { return s.v + kSumUnits * kRoundoff * s.size * Noise::next(); }

struct PixelSums {
    Sum s[9];  ///< in the order of SplatSums
};

/// Planes of the loss, kept from sample to sample: for large images, new memory takes longer than what is done with it.
struct LossPlanes {
    std::vector<Noisy> x, y, xx, yy, xy, weight, p, q, r, across, filtered[8];
};

/// Filters with the separable 11x11 window and zero padding.
void filter_window(const std::vector<Noisy>& in, int w, int h, const SsimTaps<double>& taps, std::uint64_t sample,
                   std::vector<Noisy>& across, std::vector<Noisy>& out) {
    constexpr double kUnits = 3.3;  // eleven roundings of the sum so far, in quadrature
    const auto pass = [&](const std::vector<Noisy>& from, bool down, std::vector<Noisy>& to) {
        to.resize(from.size());
        parallel_for(h, [&](std::int64_t y) {
            Noise::start(sample, std::uint64_t(y));
            for (int x = 0; x < w; ++x) {
                double v = 0, size = 0;
                const int at = down ? int(y) : x, low = std::max(-kSsimRadius, -at),
                          high = std::min(kSsimRadius, (down ? h : w) - 1 - at);
                const Noisy* centre = &from[std::size_t(y) * w + x];
                for (int k = low; k <= high; ++k) {
                    const double term = taps.g[std::abs(k)] * centre[down ? std::ptrdiff_t(k) * w : k].v;
                    v += term, size += std::abs(term);
                }
                to[std::size_t(y) * w + x].v = v + kUnits * kRoundoff * size * Noise::next();
            }
        });
    };
    pass(in, false, across);
    pass(across, true, out);
}

struct NoisyLoss {
    double l1 = 0, ssim = 0, loss = 0;
    std::vector<Noisy> dL_dimage;
};

NoisyLoss noisy_loss(const std::vector<Noisy>& image, const TargetImage& t, const Vec3<float>& background,
                     double lambda, std::uint64_t sample, LossPlanes& planes) {
    const int w = t.width, h = t.height;
    const std::size_t plane = std::size_t(w) * h;
    NoisyLoss out;
    out.dL_dimage.assign(3 * plane, Noisy(0));
    double weight_sum = double(plane);
    if (t.mask) weight_sum = std::accumulate(t.mask, t.mask + plane, 0.0) / 255;
    if (weight_sum <= 0) return out;
    SsimTaps<double> taps;
    for (double& g : taps.g) g = double(float(g));
    const double norm = 1 / (3 * weight_sum);
    const auto stored = [&](std::size_t k) { return t.u8 ? Noisy(t.u8[k]) * Noisy(1.0 / 255) : Noisy(t.f32[k]); };
    const float bg[3] = {background.x, background.y, background.z};
    std::vector<double> l1(h), ssim(h);
    for (int c = 0; c < 3; ++c) {
        auto &x = planes.x, &y = planes.y, &xx = planes.xx, &yy = planes.yy, &xy = planes.xy, &weight = planes.weight,
             &p = planes.p, &q = planes.q, &r = planes.r;
        for (auto* of : {&x, &y, &xx, &yy, &xy, &weight, &p, &q, &r}) of->resize(plane);
        const auto for_pixels = [&](auto&& pixel) {
            parallel_for(h, [&](std::int64_t row) {
                Noise::start(sample, std::uint64_t(row));
                for (std::size_t i = std::size_t(row) * w, end = i + w; i < end; ++i) pixel(i, row);
            });
        };
        for_pixels([&](std::size_t i, std::int64_t) {
            Noisy target = stored(i * t.channels + c);
            if (t.channels == 4) {
                const Noisy alpha = stored(i * 4 + 3);
                target = gs::gs_clamp(alpha * target + (Noisy(1) - alpha) * Noisy(bg[c]), Noisy(0), Noisy(1));
            }
            weight[i] = t.mask ? Noisy(t.mask[i]) * Noisy(1.0 / 255) : Noisy(1);
            x[i] = t.mask ? weight[i] * image[c * plane + i] : image[c * plane + i];
            y[i] = t.mask ? weight[i] * target : target;
            xx[i] = x[i] * x[i], yy[i] = y[i] * y[i], xy[i] = x[i] * y[i];
        });
        const auto filter = [&](const std::vector<Noisy>& in, int number) -> const std::vector<Noisy>& {
            filter_window(in, w, h, taps, 100 * sample + 10 * std::uint64_t(c) + std::uint64_t(number), planes.across,
                          planes.filtered[number]);
            return planes.filtered[number];
        };
        const auto &mx = filter(x, 0), &my = filter(y, 1), &exx = filter(xx, 2), &eyy = filter(yy, 3),
                   &exy = filter(xy, 4);
        const Noisy ssim_step(-lambda * norm), l1_step((1 - lambda) * norm);
        for_pixels([&](std::size_t i, std::int64_t row) {
            const SsimPixel<Noisy> s = ssim_pixel(mx[i], my[i], exx[i], eyy[i], exy[i]);
            const Noisy u = ssim_step * weight[i];
            p[i] = u * s.p, q[i] = u * s.q, r[i] = u * s.r;
            ssim[row] += weight[i].v * s.ssim.v;
        });
        const auto &fp = filter(p, 5), &fq = filter(q, 6), &fr = filter(r, 7);
        for_pixels([&](std::size_t i, std::int64_t row) {
            const Noisy d = x[i] - y[i];
            const Noisy g = l1_step * Noisy(d.v > 0   ? 1
                                            : d.v < 0 ? -1
                                                      : 0) +
                            fp[i] + Noisy(2) * x[i] * fq[i] + y[i] * fr[i];
            l1[row] += std::abs(d.v);
            out.dL_dimage[c * plane + i] = t.mask ? g * weight[i] : g;
        });
    }
    for (int row = 0; row < h; ++row) out.l1 += norm * l1[row], out.ssim += norm * ssim[row];
    out.loss = (1 - lambda) * out.l1 + lambda * (1 - out.ssim);
    return out;
}

template <class Model> class Sample {
  public:
    std::array<std::vector<double>, kNumGroups> gradient;
    std::vector<double> statistic;
    double l1, ssim, loss;

    Sample(const Gaussians& model, const StepRequest& r, std::uint64_t sample, LossPlanes& planes)
        : scene_(model, r.camera, r.background, RenderMode::kFull, sample), sample_(sample) {
        blend();
        NoisyLoss l = noisy_loss(rgb_, r.target, r.background, double(r.loss.lambda_dssim), sample, planes);
        l1 = l.l1, ssim = l.ssim, loss = l.loss;
        dL_dimage_ = std::move(l.dL_dimage);
        const std::vector<SplatSums<Noisy>> sums = backward();
        for (int g = 0; g < kNumGroups; ++g) gradient[g].resize(model.groups[g].param.size());
        statistic.resize(model.count);
        parallel_for_rows(model.count, [&](std::int64_t i) { gaussian(model, r, i, sums[i]); });
    }

  private:
    void blend() {
        const std::size_t plane = std::size_t(scene_.width) * scene_.height;
        rgb_.resize(3 * plane), transmittance_.resize(plane);
        parallel_for(std::int64_t(scene_.lists.size()), [&](std::int64_t tile) {
            Noise::start(sample_, std::uint64_t(tile));
            scene_.for_pixels(int(tile), [&](int x, int y) {
                PixelForward<Noisy> p{Noisy(1), Noisy(0), Noisy(0), Noisy(0)};
                for (const std::uint32_t i : scene_.lists[tile]) {
                    if (p.t.v < kMinTransmittance) break;
                    const Splat<Noisy>& s = scene_.splats[i];
                    if (!scene_.far(i, x, y))
                        blend_fragment<Noisy, Noisy>(p, scene_.fragment(i, x, y).alpha, s.color.x, s.color.y,
                                                     s.color.z);
                }
                const std::size_t at = std::size_t(y) * scene_.width + x;
                rgb_[at] = p.r + p.t * scene_.background.x, rgb_[at + plane] = p.g + p.t * scene_.background.y;
                rgb_[at + 2 * plane] = p.b + p.t * scene_.background.z, transmittance_[at] = p.t;
            });
        });
    }

    std::vector<SplatSums<Noisy>> backward() const {
        constexpr int kParts = 32;
        const std::int64_t n = scene_.model.count;
        std::vector<std::vector<SplatSums<Noisy>>> parts(kParts);
        parallel_for(kParts, [&](std::int64_t part) {
            parts[part].assign(n, SplatSums<Noisy>{});
            std::vector<PixelSums> local;
            for (int tile = int(part); tile < int(scene_.lists.size()); tile += kParts) {
                const auto& list = scene_.lists[tile];
                if (list.empty()) continue;
                Noise::start(sample_, std::uint64_t(tile));
                for (int sub = 0; sub < kTile * kTile / (kSubX * kSubY); ++sub) {
                    const int x0 = tile % scene_.tiles_x * kTile + sub % (kTile / kSubX) * kSubX,
                              y0 = tile / scene_.tiles_x * kTile + sub / (kTile / kSubX) * kSubY;
                    local.assign(list.size(), {});
                    for (int y = y0; y < std::min(y0 + kSubY, scene_.height); ++y)
                        for (int x = x0; x < std::min(x0 + kSubX, scene_.width); ++x) backward_pixel(list, x, y, local);
                    for (std::size_t k = 0; k < list.size(); ++k) {
                        if (local[k].s[0].size == 0 && local[k].s[6].size == 0) continue;
                        SplatSums<Noisy>& to = parts[part][list[k]];
                        Noisy* const sums[9] = {&to.h, &to.hx, &to.hy, &to.hxx, &to.hxy, &to.hyy, &to.r, &to.g, &to.b};
                        for (int m = 0; m < 9; ++m) *sums[m] = Noisy::of(sums[m]->v + noise_of_sum(local[k].s[m]), 1);
                    }
                }
            }
        });
        for (std::int64_t i = 0; i < n; ++i)
            for (int part = 1; part < kParts; ++part) {
                SplatSums<Noisy>&to = parts[0][i], &from = parts[part][i];
                to.h.v += from.h.v, to.hx.v += from.hx.v, to.hy.v += from.hy.v, to.hxx.v += from.hxx.v,
                    to.hxy.v += from.hxy.v, to.hyy.v += from.hyy.v;
                to.r.v += from.r.v, to.g.v += from.g.v, to.b.v += from.b.v;
            }
        return std::move(parts[0]);
    }

    void backward_pixel(const std::vector<std::uint32_t>& list, int x, int y, std::vector<PixelSums>& sums) const {
        const std::size_t plane = std::size_t(scene_.width) * scene_.height, at = std::size_t(y) * scene_.width + x;
        PixelBackward<Noisy> p{};
        p.t = Noisy(1);
        p.gr = dL_dimage_[at], p.gg = dL_dimage_[at + plane], p.gb = dL_dimage_[at + 2 * plane];
        const Noisy t = transmittance_[at];
        p.background = t * (p.gr * scene_.background.x + p.gg * scene_.background.y + p.gb * scene_.background.z);
        // Channel by channel, as where a list begins at a saved state.
        p.behind = rgb_[at] * p.gr + rgb_[at + plane] * p.gg + rgb_[at + 2 * plane] * p.gb;
        for (std::size_t k = 0; k < list.size(); ++k) {
            if (p.t.v < kMinTransmittance) break;
            const Splat<Noisy>& s = scene_.splats[list[k]];
            if (scene_.far(list[k], x, y)) continue;
            const LensFragment<Noisy> f = scene_.fragment(list[k], x, y);
            const FragmentGradient<Noisy> d =
                fragment_gradient<Noisy, Noisy>(p, f.alpha, color_gradient(p, s.color.x, s.color.y, s.color.z));
            const double h = d.h.v, dx = f.dx.v, dy = f.dy.v, size = std::abs(h), X = std::abs(dx),
                         Y = std::abs(dy) + kMomentShift;
            Sum* to = sums[k].s;
            to[0].add(h, size), to[1].add(h * dx * f.w.v, size * X), to[2].add(h * dy * f.w.v, size * Y);
            to[3].add(h * dx * dx, size * X * X), to[4].add(h * dx * dy, size * X * Y),
                to[5].add(h * dy * dy, size * Y * Y);
            to[6].add(d.w.v * p.gr.v, std::abs(d.w.v * p.gr.v)), to[7].add(d.w.v * p.gg.v, std::abs(d.w.v * p.gg.v));
            to[8].add(d.w.v * p.gb.v, std::abs(d.w.v * p.gb.v));
        }
    }

    void gaussian(const Gaussians& model, const StepRequest& r, std::int64_t i, const SplatSums<Noisy>& sums) {
        Noise::start(sample_, std::uint64_t(i));
        GaussianGradient<Noisy> g{};
        Noisy residual[Model::kMaxResidual > 0 ? Model::kMaxResidual : 1] = {};
        if (scene_.visible[i])
            gaussian_backward<Model>(scene_.view(), i, scene_.camera, scene_.degree, sums, false, g, residual,
                                     static_cast<Noisy*>(nullptr));
        const Noisy opacity = sigmoid(Noisy(model[Group::kOpacity].param[i])), n{double(model.count)};
        g.geometry.raw_opacity =
            g.geometry.raw_opacity + Noisy(r.loss.opacity_reg) / n * opacity * (Noisy(1) - opacity);
        const auto scale = [&](int k) {
            return Noisy(r.loss.scale_reg) / (Noisy(3) * n) *
                   gs_exp(gs::gs_min(Noisy(model[Group::kScale].param[3 * i + k]), Noisy(kMaxLogScale)));
        };
        g.geometry.log_scale += Vec3<Noisy>{scale(0), scale(1), scale(2)};
        const auto put = [&](Group group, std::initializer_list<Noisy> values) {
            double* to = gradient[int(group)].data() + i * std::int64_t(values.size());
            for (const Noisy x : values) *to++ = x.v;
        };
        const auto& q = g.geometry;
        put(Group::kMean, {q.mean.x, q.mean.y, q.mean.z});
        put(Group::kScale, {q.log_scale.x, q.log_scale.y, q.log_scale.z});
        put(Group::kRotation, {q.rotation.x, q.rotation.y, q.rotation.z, q.rotation.w});
        put(Group::kOpacity, {q.raw_opacity});
        put(Group::kBase, {g.base.x, g.base.y, g.base.z});
        const int width = model[Group::kResidual].width;
        for (int k = 0; k < width; ++k) gradient[int(Group::kResidual)][i * width + k] = residual[k].v;
        const Noisy x = Noisy(0.5 * r.camera.width) * g.mean2d.x, y = Noisy(0.5 * r.camera.height) * g.mean2d.y;
        statistic[i] = gs_sqrt(x * x + y * y).v;
    }

    const Projected<Model, Noisy> scene_;
    const std::uint64_t sample_;
    std::vector<Noisy> rgb_, transmittance_, dL_dimage_;
};

/// Computes the step in double with the CPU backend's parts.
template <class Model> StepReference double_step(const Gaussians& model, const StepRequest& r) {
    const auto d = cast<double>(model);
    Pipeline<double, Model> pipe;
    pipe.render(d, cast<double>(r.camera), {r.background.x, r.background.y, r.background.z});
    std::vector<double> dL_dimage(pipe.image.size());
    ImageLoss<double> loss;
    const ViewLoss values = loss.compute(pipe.image.data(), r.target, r.background, r.loss, dL_dimage.data());
    auto gradients = pipe.gradients(d, dL_dimage);
    StepReference out;
    out.loss = {values.loss, 0}, out.l1 = {values.l1, 0}, out.ssim = {values.ssim, 0};
    const double n = double(model.count);
    const auto view = ParameterView<double>::of(d);
    std::vector<double> ignored(d.shared.param.size());
    for (std::int64_t i = 0; i < model.count; ++i) {
        const double opacity = sigmoid(d[Group::kOpacity].param[i]);
        gradients[Group::kOpacity].param[i] += double(r.loss.opacity_reg) / n * opacity * (1 - opacity);
        for (int k = 0; k < 3; ++k)
            gradients[Group::kScale].param[3 * i + k] +=
                double(r.loss.scale_reg) / (3 * n) *
                std::exp(std::min(d[Group::kScale].param[3 * i + k], kMaxLogScale));
        typename CpuRasterizer<double, Model>::FullGradient g;
        pipe.raster.gaussian_gradient(view, i, false, g, ignored.data());
        out.statistic.push_back({std::hypot(0.5 * r.camera.width * g.mean2d.x, 0.5 * r.camera.height * g.mean2d.y), 0});
    }
    for (int k = 0; k < kNumGroups; ++k)
        for (const double x : gradients.groups[k].param) out.gradient[k].push_back({x, 0});
    return out;
}

/// Gives rows of `width` values the root mean square of their largest component's spread, and their own rounding.
void set_allowance(std::vector<Rounded>& values, int width, const std::vector<const double*>& samples) {
    for (std::size_t row = 0; row < values.size(); row += width) {
        double worst = 0;
        for (std::size_t i = row; i < row + width; ++i) {
            double sum = 0;
            for (const double* s : samples) sum += (s[i] - values[i].v) * (s[i] - values[i].v);
            worst = std::max(worst, std::sqrt(sum / double(samples.size())));
        }
        for (std::size_t i = row; i < row + width; ++i)
            values[i].e = kSpread * worst + 4 * kRoundoff * std::abs(values[i].v) + (worst > 0 ? kFlushed : 0);
    }
}

template <class Model> StepReference step_with(const Gaussians& model, const StepRequest& r) {
    StepReference out = double_step<Model>(model, r);
    std::vector<std::unique_ptr<Sample<Model>>> samples;
    LossPlanes planes;
    for (int k = 0; k < kSamples; ++k)
        samples.push_back(std::make_unique<Sample<Model>>(model, r, std::uint64_t(k + 1), planes));
    const auto collect = [&](auto&& field) {
        std::vector<const double*> pointers;
        for (const auto& s : samples) pointers.push_back(field(*s));
        return pointers;
    };
    for (int g = 0; g < kNumGroups; ++g)
        set_allowance(out.gradient[g], model.groups[g].width,
                      collect([g](const auto& s) { return s.gradient[g].data(); }));
    set_allowance(out.statistic, 1, collect([](const auto& s) { return s.statistic.data(); }));
    std::vector<Rounded> scalar(1);
    for (auto [value, field] : {std::pair{&out.l1, &Sample<Model>::l1},
                                {&out.ssim, &Sample<Model>::ssim},
                                {&out.loss, &Sample<Model>::loss}}) {
        scalar[0] = *value;
        set_allowance(scalar, 1, collect([field = field](const auto& s) { return &(s.*field); }));
        *value = scalar[0];
        value->e +=
            64 * kRoundoff * std::abs(value->v);  // floats are added along a row or in a block before doubles are
    }
    return out;
}

}  // namespace

RenderReference reference_render(const Gaussians& model, const RenderRequest& request) {
    return model.appearance.model == "none" ? bounded_render<appearance::None>(model, request)
                                            : bounded_render<appearance::Sh>(model, request);
}

StepReference reference_step(const Gaussians& model, const StepRequest& request) {
    return model.appearance.model == "none" ? step_with<appearance::None>(model, request)
                                            : step_with<appearance::Sh>(model, request);
}

}  // namespace gs::test
