// SPDX-License-Identifier: Apache-2.0
// Computes PSNR in double precision, summed by rows, and SSIM by separable filtering in double precision.
#include "eval/metrics/pixel_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"

namespace gs {
namespace {

constexpr int kRadius = 5, kTaps = 2 * kRadius + 1;
constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

std::array<double, kTaps> gaussian_window() {
    std::array<double, kTaps> taps{};
    double sum = 0;
    for (int i = 0; i < kTaps; ++i) sum += taps[i] = std::exp(-(i - kRadius) * (i - kRadius) / 4.5);
    for (double& tap : taps) tap /= sum;
    return taps;
}

/// One channel, padded on each side so that every counted window lies inside.
struct PaddedChannel {
    int width, height;
    std::vector<double> values;
};

/// Returns the index of pixel i in a row of n pixels mirrored about its first and last pixel.
int reflected(int i, int n) { return i < 0 ? -i : (i >= n ? 2 * n - 2 - i : i); }

PaddedChannel padded_channel(const Image& image, int channel, SsimBorder border) {
    const int pad = border == SsimBorder::kValid ? 0 : kRadius;
    PaddedChannel plane{image.width + 2 * pad, image.height + 2 * pad, {}};
    plane.values.assign(std::size_t(plane.width) * plane.height, 0.0);
    for (int y = 0; y < plane.height; ++y) {
        for (int x = 0; x < plane.width; ++x) {
            int sx = x - pad, sy = y - pad;
            if (border == SsimBorder::kReflect) sx = reflected(sx, image.width), sy = reflected(sy, image.height);
            if (sx < 0 || sy < 0 || sx >= image.width || sy >= image.height) continue;
            plane.values[std::size_t(y) * plane.width + x] = image.value(sx, sy, channel);
        }
    }
    return plane;
}

double ssim_of_moments(const double m[5]) {
    const double variance_a = std::max(m[2] - m[0] * m[0], 0.0), variance_b = std::max(m[3] - m[1] * m[1], 0.0);
    const double covariance = m[4] - m[0] * m[1];
    return (2 * m[0] * m[1] + kC1) * (2 * covariance + kC2) /
           ((m[0] * m[0] + m[1] * m[1] + kC1) * (variance_a + variance_b + kC2));
}

/// Returns the sum of the SSIM map over all windows inside the planes.
double ssim_sum(const PaddedChannel& a, const PaddedChannel& b) {
    static const auto taps = gaussian_window();
    const int width = a.width - 2 * kRadius, height = a.height - 2 * kRadius;
    // Moments a, b, aa, bb, ab, filtered along x: (a.height, width, 5).
    std::vector<double> rows(std::size_t(a.height) * width * 5);
    parallel_for(a.height, [&](std::int64_t y) {
        for (int x = 0; x < width; ++x) {
            double* m = &rows[(std::size_t(y) * width + x) * 5];
            for (int k = 0; k < kTaps; ++k) {
                const double va = a.values[std::size_t(y) * a.width + x + k],
                             vb = b.values[std::size_t(y) * a.width + x + k];
                m[0] += taps[k] * va, m[1] += taps[k] * vb;
                m[2] += taps[k] * va * va, m[3] += taps[k] * vb * vb, m[4] += taps[k] * va * vb;
            }
        }
    });
    std::vector<double> row_sums(height);  // summed in order, independently of the number of threads
    parallel_for(height, [&](std::int64_t y) {
        for (int x = 0; x < width; ++x) {
            double m[5] = {};
            for (int k = 0; k < kTaps; ++k) {
                for (int i = 0; i < 5; ++i) m[i] += taps[k] * rows[(std::size_t(y + k) * width + x) * 5 + i];
            }
            row_sums[y] += ssim_of_moments(m);
        }
    });
    double sum = 0;
    for (const double row : row_sums) sum += row;
    return sum;
}

}  // namespace

void require_same_size(const Image& a, const Image& b) {
    if (a.width == b.width && a.height == b.height && a.channels == b.channels && a.bytes() > 0 && b.bytes() > 0)
        return;
    throw UsageError(fmt::format("images to compare must be of one size and not empty: {}x{}x{} and {}x{}x{}", a.width,
                                 a.height, a.channels, b.width, b.height, b.channels));
}

double psnr(const Image& a, const Image& b) {
    require_same_size(a, b);
    double sum = 0;
    for (int y = 0; y < a.height; ++y) {
        double row = 0;
        for (int x = 0; x < a.width; ++x) {
            for (int c = 0; c < a.channels; ++c) {
                const double difference = double(a.value(x, y, c)) - double(b.value(x, y, c));
                row += difference * difference;
            }
        }
        sum += row;
    }
    if (sum == 0) return std::numeric_limits<double>::infinity();
    return -10 * std::log10(sum / (double(a.width) * a.height * a.channels));
}

double ssim(const Image& a, const Image& b, SsimBorder border) {
    require_same_size(a, b);
    if (std::min(a.width, a.height) < kTaps) border = SsimBorder::kZero;
    double sum = 0;
    std::size_t count = 0;
    for (int c = 0; c < a.channels; ++c) {
        const PaddedChannel pa = padded_channel(a, c, border), pb = padded_channel(b, c, border);
        sum += ssim_sum(pa, pb);
        count += std::size_t(pa.width - 2 * kRadius) * (pa.height - 2 * kRadius);
    }
    return sum / double(count);
}

SsimBorder parse_ssim_border(const std::string& name) {
    if (name == "valid") return SsimBorder::kValid;
    if (name == "reflect") return SsimBorder::kReflect;
    if (name == "zero") return SsimBorder::kZero;
    throw UsageError(fmt::format("--ssim-border: '{}' is not one of valid, reflect, zero", name));
}

std::string describe_ssim(SsimBorder border) {
    const std::string window = "11x11 Gaussian, sigma 1.5, k1 0.01, k2 0.03, ";
    if (border == SsimBorder::kValid) return window + "windows inside the image only (torchmetrics <= 1.4.1)";
    if (border == SsimBorder::kReflect) return window + "mirrored borders, all pixels (torchmetrics >= 1.4.2)";
    return window + "zero padding, all pixels (3DGS metrics.py)";
}

}  // namespace gs
