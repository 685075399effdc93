// SPDX-License-Identifier: Apache-2.0
// The loss on the CPU. Each row applies a vertical filter over 11 rows and then a horizontal filter to the filtered
// row, both along contiguous memory. No filtered image is stored. The second pass filters the three derivative maps
// likewise.
#include "kernels/loss/loss.h"

#include <algorithm>

#include "kernels/base/parallel.h"
#include "kernels/loss/loss_device.h"

namespace gs {
namespace {

constexpr int kRows = 8;  ///< rows per task

/// Scratch rows, with zeros on both sides for the horizontal filter. Their memory is thread-local and is reused, so
/// that iterations allocate none. A thread may use only one object at a time.
template <class Real> struct RowScratch {
    std::vector<Real>& data;
    int stride;
    RowScratch(int rows, int width) : data(memory()), stride(width + 2 * kSsimRadius) {
        data.assign(std::size_t(rows) * stride, Real(0));
    }
    Real* row(int k) { return data.data() + std::size_t(k) * stride + kSsimRadius; }

  private:
    static std::vector<Real>& memory() {
        static thread_local std::vector<Real> rows;
        return rows;
    }
};

template <class Real> void filter_row(const Real* in, const SsimTaps<Real>& taps, int width, Real* out) {
    const Real g0 = taps.g[0], g1 = taps.g[1], g2 = taps.g[2], g3 = taps.g[3], g4 = taps.g[4], g5 = taps.g[5];
#pragma omp simd
    for (int x = 0; x < width; ++x)
        out[x] = g0 * in[x] + g1 * (in[x - 1] + in[x + 1]) + g2 * (in[x - 2] + in[x + 2]) +
                 g3 * (in[x - 3] + in[x + 3]) + g4 * (in[x - 4] + in[x + 4]) + g5 * (in[x - 5] + in[x + 5]);
}

template <class Real> struct Plane {
    const Real* data;
    int width, height;
};

/// The rows of a plane that the window of row y covers, from top to bottom; zeros outside the plane.
template <class Real> struct Window {
    static constexpr int kRows = 2 * kSsimRadius + 1;
    const Real* rows[kRows];

    Window(const Plane<Real>& plane, int y, const Real* zeros) {
        for (int t = 0; t < kRows; ++t) {
            const int j = y + t - kSsimRadius;
            rows[t] = j >= 0 && j < plane.height ? plane.data + std::size_t(j) * plane.width : zeros;
        }
    }
};

/// Computes the vertical moments of a window: out[0..4] = G*x, G*y, G*x^2, G*y^2, G*xy. Sums stay in registers across
/// the rows.
template <class Real>
void vertical_moments(const Window<Real>& a, const Window<Real>& b, const SsimTaps<Real>& taps, int width,
                      Real* const out[5]) {
    Real *o0 = out[0], *o1 = out[1], *o2 = out[2], *o3 = out[3], *o4 = out[4];
#pragma omp simd
    for (int x = 0; x < width; ++x) {
        Real mx = 0, my = 0, xx = 0, yy = 0, xy = 0;
#pragma GCC unroll 11
        for (int t = 0; t < Window<Real>::kRows; ++t) {
            const Real g = taps.g[t < kSsimRadius ? kSsimRadius - t : t - kSsimRadius], p = a.rows[t][x],
                       q = b.rows[t][x], gp = g * p, gq = g * q;
            mx += gp, my += gq, xx += gp * p, yy += gq * q, xy += gp * q;
        }
        o0[x] = mx, o1[x] = my, o2[x] = xx, o3[x] = yy, o4[x] = xy;
    }
}

/// Filters a window vertically.
template <class Real> void filter_column(const Window<Real>& in, const SsimTaps<Real>& taps, int width, Real* out) {
#pragma omp simd
    for (int x = 0; x < width; ++x) {
        Real sum = 0;
#pragma GCC unroll 11
        for (int t = 0; t < Window<Real>::kRows; ++t)
            sum += taps.g[t < kSsimRadius ? kSsimRadius - t : t - kSsimRadius] * in.rows[t][x];
        out[x] = sum;
    }
}

/// Computes the SSIM of a row from its filtered moments, and writes its derivatives, times `step` and the weight of the
/// pixel, to p, q and r. Returns the weighted sum. Without weights each pixel counts 1. This is a template argument
/// because GCC does not vectorise a loop that tests for weights.
template <bool kWeighted, class Real>
Real ssim_row(const Real* const moments[5], const Real* weight, Real step, int width, Real* p, Real* q, Real* r) {
    const Real *mx = moments[0], *my = moments[1], *xx = moments[2], *yy = moments[3], *xy = moments[4];
    Real sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int x = 0; x < width; ++x) {
        const SsimPixel<Real> s = ssim_pixel(mx[x], my[x], xx[x], yy[x], xy[x]);
        const Real w = kWeighted ? weight[x] : Real(1), u = step * w;
        sum += w * s.ssim;
        p[x] = u * s.p, q[x] = u * s.q, r[x] = u * s.r;
    }
    return sum;
}

/// Writes the gradient of a row of the render from the filtered derivatives p, q and r of SSIM. Returns the sum of
/// absolute differences. Masked images are already multiplied by the weight m: |m d| = m |d|.
template <bool kWeighted, class Real>
Real gradient_row(const Real* render, const Real* target, const Real* const derivatives[3], const Real* weight,
                  Real l1_weight, int width, Real* out) {
    const Real *p = derivatives[0], *q = derivatives[1], *r = derivatives[2];
    Real sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int x = 0; x < width; ++x) {
        const L1Pixel<Real> l1 = l1_pixel(render[x] - target[x]);
        sum += l1.value;
        const Real g = l1_weight * l1.slope + p[x] + Real(2) * render[x] * q[x] + target[x] * r[x];
        out[x] = kWeighted ? g * weight[x] : g;
    }
    return sum;
}

/// Decodes the target to planar (3,H,W): composited on the background, clamped to [0,1].
template <class Real> void decode_target(const TargetImage& t, const Vec3<float>& background, std::vector<Real>& out) {
    const std::size_t pixels = std::size_t(t.width) * t.height;
    out.resize(3 * pixels);
    const Real bg[3] = {Real(background.x), Real(background.y), Real(background.z)};
    const auto decode = [&](const auto* data, Real full) {
        parallel_for(t.height, [&](std::int64_t y) {
            const auto* px = data + std::size_t(y) * t.width * t.channels;
            for (int c = 0; c < 3; ++c) {
                Real* row = &out[c * pixels + std::size_t(y) * t.width];
                if (t.channels == 3) {
                    for (int x = 0; x < t.width; ++x) row[x] = px[3 * x + c] / full;
                } else {
                    for (int x = 0; x < t.width; ++x) {
                        const Real alpha = px[4 * x + 3] / full;
                        row[x] =
                            std::clamp(alpha * (px[4 * x + c] / full) + (Real(1) - alpha) * bg[c], Real(0), Real(1));
                    }
                }
            }
        });
    };
    if (t.u8)
        decode(t.u8, Real(255));
    else
        decode(t.f32, Real(1));
}

}  // namespace

template <class Real>
double ImageLoss<Real>::apply_mask(const Real* image, const std::uint8_t* mask, std::size_t pixels) {
    weight_.resize(pixels);
    masked_.resize(3 * pixels);
    double weight_sum = 0;
    for (std::size_t i = 0; i < pixels; ++i) weight_sum += weight_[i] = mask[i] * (Real(1) / Real(255));
    for (std::size_t c = 0; c < 3 * pixels; c += pixels)
        for (std::size_t i = 0; i < pixels; ++i)
            masked_[c + i] = image[c + i] * weight_[i], target_[c + i] *= weight_[i];
    return weight_sum;
}

template <class Real>
ViewLoss ImageLoss<Real>::compute(const Real* image, const TargetImage& target, const Vec3<float>& background,
                                  const LossWeights& weights, Real* dL_dimage) {
    static const SsimTaps<Real> taps;
    const int w = target.width, h = target.height;
    const std::size_t pixels = std::size_t(w) * h;
    decode_target(target, background, target_);

    const Real* render = image;
    double weight_sum = double(pixels);
    weight_.clear();
    if (target.mask) {
        weight_sum = apply_mask(image, target.mask, pixels);
        render = masked_.data();
    }
    if (weight_sum <= 0) {
        std::fill(dL_dimage, dL_dimage + 3 * pixels, Real(0));
        return {};
    }
    const bool is_weighted = !weight_.empty();
    const auto weight_row = [&](int y) { return is_weighted ? &weight_[std::size_t(y) * w] : nullptr; };
    const auto ssim_of_row = is_weighted ? ssim_row<true, Real> : ssim_row<false, Real>;
    const auto gradient_of_row = is_weighted ? gradient_row<true, Real> : gradient_row<false, Real>;
    const double norm = 1.0 / (3 * weight_sum), lambda = weights.lambda_dssim;
    const Real l1_weight = Real((1 - lambda) * norm), ssim_weight = Real(-lambda * norm);
    maps_.resize(3 * 3 * pixels);

    const std::int64_t strips = (h + kRows - 1) / kRows, tasks = 3 * strips;
    l1_sums_.assign(tasks, 0.0);
    ssim_sums_.assign(tasks, 0.0);
    parallel_for(tasks, [&](std::int64_t task) {
        const std::size_t c = task / strips;
        const Plane<Real> a{render + c * pixels, w, h}, b{target_.data() + c * pixels, w, h};
        RowScratch<Real> v(11, w);  // 5 rows filtered vertically, 5 filtered in both directions, and zeros
        const Real* const zeros = v.row(10);
        Real* const vertical[5] = {v.row(0), v.row(1), v.row(2), v.row(3), v.row(4)};
        Real* const filtered[5] = {v.row(5), v.row(6), v.row(7), v.row(8), v.row(9)};
        double ssim_sum = 0;
        for (int y = int(task % strips) * kRows, end = std::min(h, y + kRows); y < end; ++y) {
            vertical_moments(Window<Real>(a, y, zeros), Window<Real>(b, y, zeros), taps, w, vertical);
            for (int k = 0; k < 5; ++k) filter_row(vertical[k], taps, w, filtered[k]);
            Real* p = &maps_[(3 * c) * pixels + std::size_t(y) * w];
            ssim_sum += ssim_of_row(filtered, weight_row(y), ssim_weight, w, p, p + pixels, p + 2 * pixels);
        }
        ssim_sums_[task] = ssim_sum;
    });
    parallel_for(tasks, [&](std::int64_t task) {
        const std::size_t c = task / strips;
        const Plane<Real> a{render + c * pixels, w, h}, b{target_.data() + c * pixels, w, h};
        RowScratch<Real> v(5, w);  // a row filtered vertically, 3 filtered in both directions, and zeros
        const Real* const zeros = v.row(4);
        Real* const filtered[3] = {v.row(1), v.row(2), v.row(3)};
        double l1_sum = 0;
        for (int y = int(task % strips) * kRows, end = std::min(h, y + kRows); y < end; ++y) {
            for (int k = 0; k < 3; ++k) {
                const Plane<Real> map{&maps_[(3 * c + k) * pixels], w, h};
                filter_column(Window<Real>(map, y, zeros), taps, w, v.row(0));
                filter_row(v.row(0), taps, w, filtered[k]);
            }
            const std::size_t row = std::size_t(y) * w;
            l1_sum += gradient_of_row(a.data + row, b.data + row, filtered, weight_row(y), l1_weight, w,
                                      dL_dimage + c * pixels + row);
        }
        l1_sums_[task] = l1_sum;
    });
    double l1_sum = 0, ssim_sum = 0;
    for (std::int64_t task = 0; task < tasks; ++task) l1_sum += l1_sums_[task], ssim_sum += ssim_sums_[task];
    return loss_of_sums(l1_sum, ssim_sum, weights, weight_sum);
}

template <class Real> void ImageLoss<Real>::mask_weights(const TargetImage& target, Real* out) const {
    const std::size_t pixels = std::size_t(target.width) * target.height;
    if (!target.mask) {
        std::fill_n(out, 3 * pixels, Real(1));
        return;
    }
    for (std::size_t c = 0; c < 3 * pixels; c += pixels)
        for (std::size_t i = 0; i < pixels; ++i) out[c + i] = target.mask[i] * Real(1.0 / 255);
}

template <class Real>
double ImageLoss<Real>::half_squared_error(const Real* image, const TargetImage& target, const Vec3<float>& background,
                                           Real* out) {
    decode_target(target, background, target_);
    mask_weights(target, out);
    double sum = 0;
    for (std::size_t k = 0; k < 3 * std::size_t(target.width) * target.height; ++k) {
        const Real difference = image[k] - target_[k];
        sum += 0.5 * double(out[k]) * double(difference) * double(difference);
        out[k] *= difference;
    }
    return sum;
}

template class ImageLoss<float>;
template class ImageLoss<double>;

}  // namespace gs
