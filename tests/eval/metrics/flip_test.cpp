// SPDX-License-Identifier: Apache-2.0
// FLIP against a second implementation written window by window from the paper's formulas, and against values by hand.
#include "eval/metrics/flip.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "tests/eval/support/random_weights.h"

namespace gs {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Image constant(int width, int height, std::uint8_t r, std::uint8_t g, std::uint8_t b) {
    Image image{width, height, 3, {}, {}};
    for (int i = 0; i < width * height; ++i) image.u8.insert(image.u8.end(), {r, g, b});
    return image;
}

/// Computes FLIP by its definition, with full two-dimensional kernels.
class PaperFlip {
  public:
    explicit PaperFlip(double ppd) : ppd_(ppd) {
        xyz_ << 10135552. / 24577794, 8788810. / 24577794, 4435075. / 24577794, 2613072. / 12288897,
            8788810. / 12288897, 887015. / 12288897, 1425312. / 73733382, 8788810. / 73733382, 70074185. / 73733382;
        white_ = xyz_ * Vector3d::Ones();
    }

    double error(const Image& reference, const Image& test, int x, int y) const {
        const double color = color_error(hunt_lab(seen(reference, x, y)), hunt_lab(seen(test, x, y)));
        const double edges = std::abs(feature(reference, x, y, false) - feature(test, x, y, false));
        const double points = std::abs(feature(reference, x, y, true) - feature(test, x, y, true));
        return std::pow(color, 1 - std::sqrt(std::max(edges, points) / std::sqrt(2.0)));
    }

    double color_error(const Vector3d& a, const Vector3d& b) const {
        const double largest = std::pow(distance(hunt_lab({0, 1, 0}), hunt_lab({0, 0, 1})), 0.7);
        const double e = std::pow(distance(a, b), 0.7), knee = 0.4 * largest;
        return e < knee ? 0.95 * e / knee : 0.95 + 0.05 * (e - knee) / (largest - knee);
    }

    Vector3d hunt_lab(const Vector3d& linear) const {
        const Vector3d ratio = (xyz_ * linear).cwiseQuotient(white_);
        Vector3d root;
        for (int i = 0; i < 3; ++i)
            root[i] = ratio[i] > std::pow(6. / 29, 3) ? std::pow(ratio[i], 1. / 3)
                                                      : ratio[i] * std::pow(29. / 6, 2) / 3 + 4. / 29;
        const double L = 116 * root[1] - 16;
        return {L, 5 * L * (root[0] - root[1]), 2 * L * (root[1] - root[2])};
    }

  private:
    static double distance(const Vector3d& a, const Vector3d& b) {
        return std::abs(a[0] - b[0]) + (a - b).tail<2>().norm();
    }

    Vector3d opponent(const Image& image, int x, int y) const {
        x = std::min(std::max(x, 0), image.width - 1), y = std::min(std::max(y, 0), image.height - 1);
        Vector3d linear;
        for (int c = 0; c < 3; ++c) {
            const double v = image.value(x, y, c);
            linear[c] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
        }
        const Vector3d n = (xyz_ * linear).cwiseQuotient(white_);
        return {116 * n[1] - 16, 500 * (n[0] - n[1]), 200 * (n[1] - n[2])};
    }

    /// Returns clamped linear rgb after the filter of contrast sensitivity.
    Vector3d seen(const Image& image, int x, int y) const {
        const int r = int(std::ceil(3 * std::sqrt(0.04 / (2 * M_PI * M_PI)) * ppd_));
        Vector3d sum = Vector3d::Zero(), total = Vector3d::Zero();
        for (int dy = -r; dy <= r; ++dy) {
            for (int dx = -r; dx <= r; ++dx) {
                const double d2 = (dx * dx + dy * dy) / (ppd_ * ppd_);
                const auto term = [&](double a, double b) {
                    return a * std::sqrt(M_PI / b) * std::exp(-M_PI * M_PI * d2 / b);
                };
                const Vector3d weight(term(1, 0.0047), term(1, 0.0053), term(34.1, 0.04) + term(13.5, 0.025));
                sum += weight.cwiseProduct(opponent(image, x + dx, y + dy));
                total += weight;
            }
        }
        const Vector3d o = sum.cwiseQuotient(total);
        const double luma = (o[0] + 16) / 116;
        const Vector3d linear =
            xyz_.inverse() * Vector3d(luma + o[1] / 500, luma, luma - o[2] / 200).cwiseProduct(white_);
        return linear.cwiseMax(0).cwiseMin(1);
    }

    double feature(const Image& image, int x, int y, bool points) const {
        const double sd = 0.5 * 0.082 * ppd_;
        const int r = int(std::ceil(3 * sd));
        const auto kernel = [&](int dx, int dy) {
            return std::exp(-(dx * dx + dy * dy) / (2 * sd * sd)) * (points ? dx * dx / (sd * sd) - 1 : -dx);
        };
        double up = 0, down = 0;
        for (int dy = -r; dy <= r; ++dy) {
            for (int dx = -r; dx <= r; ++dx)
                up += std::max(kernel(dx, dy), 0.0), down += std::max(-kernel(dx, dy), 0.0);
        }
        double gx = 0, gy = 0;
        for (int dy = -r; dy <= r; ++dy) {
            for (int dx = -r; dx <= r; ++dx) {
                const double w = kernel(dx, dy), scaled = w > 0 ? w / up : w / down;
                gx += scaled * (opponent(image, x + dx, y + dy)[0] + 16) / 116;
                gy += scaled * (opponent(image, x + dy, y + dx)[0] + 16) / 116;
            }
        }
        return std::hypot(gx, gy);
    }

    double ppd_;
    Matrix3d xyz_;
    Vector3d white_;
};

TEST(Flip, EqualsTheDefinition) {
    const Image a = test::noise_image(23, 18, 1);
    Image b = a, edge = constant(23, 18, 200, 40, 90);
    const Image other = test::noise_image(23, 18, 2);
    for (std::size_t i = 0; i < b.u8.size(); ++i) b.u8[i] = std::uint8_t((7 * a.u8[i] + other.u8[i]) / 8);
    for (int y = 0; y < 18; ++y) {
        for (int x = 11; x < 23; ++x) edge.u8[(std::size_t(y) * 23 + x) * 3 + 1] = 220;
    }
    for (const double ppd : {kFlipPixelsPerDegree, 20.0}) {
        const PaperFlip paper(ppd);
        for (const auto& [first, second] : {std::pair(a, b), {a, other}, {edge, constant(23, 18, 200, 40, 90)}}) {
            const std::vector<double> map = flip_map(first, second, ppd);
            double worst = 0, sum = 0;
            for (int y = 0; y < 18; y += 3) {
                for (int x = 0; x < 23; x += 2)
                    worst = std::max(worst, std::abs(map[std::size_t(y) * 23 + x] - paper.error(first, second, x, y)));
            }
            EXPECT_LT(worst, 1e-6) << ppd;
            for (const double v : map) {
                EXPECT_GE(v, 0);
                EXPECT_LE(v, 1);
                sum += v;
            }
            EXPECT_NEAR(flip(first, second, ppd), sum / double(map.size()), 1e-12);
            EXPECT_EQ(flip_map(second, first, ppd), map) << "symmetric";
        }
    }
}

TEST(Flip, ConstantImagesByHand) {
    // No features, nothing to filter: what is left is the colour curve. Black to white is 100 in lightness.
    const PaperFlip paper(67);
    const double black_white = paper.color_error({0, 0, 0}, {100, 0, 0});
    EXPECT_NEAR(black_white, 0.967, 5e-4);
    EXPECT_NEAR(flip(constant(9, 7, 0, 0, 0), constant(9, 7, 255, 255, 255)), black_white, 1e-6);
    EXPECT_NEAR(flip(constant(9, 7, 0, 255, 0), constant(9, 7, 0, 0, 255)), 1, 1e-6)
        << "the largest difference there is";
    EXPECT_EQ(flip(constant(9, 7, 3, 50, 8), constant(9, 7, 3, 50, 8)), 0);
}

TEST(Flip, FromFartherAwayLessIsSeen) {
    const Image a = test::noise_image(40, 40, 3), b = test::noise_image(40, 40, 4);
    EXPECT_LT(flip(a, b, 120), flip(a, b, 30));
}

TEST(Flip, TheNumberOfThreadsChangesNoBit) {
    const Image a = test::noise_image(61, 47, 5), b = test::noise_image(61, 47, 6);
    const int threads = num_threads();
    set_num_threads(1);
    const auto one = flip_map(a, b);
    set_num_threads(3);
    const auto three = flip_map(a, b);
    set_num_threads(threads);
    EXPECT_EQ(one, three);
}

TEST(Flip, WhatDoesNotFitIsRefused) {
    const Image a = constant(4, 4, 1, 2, 3), rgba{1, 1, 4, {1, 2, 3, 4}, {}};
    EXPECT_THROW(flip(a, constant(4, 5, 1, 2, 3)), UsageError);
    EXPECT_THROW(flip(rgba, rgba), UsageError);
    EXPECT_THROW(flip(a, a, 0), UsageError);
    EXPECT_THROW(flip(a, a, std::nan("")), UsageError);
}

}  // namespace
}  // namespace gs
