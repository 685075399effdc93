// SPDX-License-Identifier: Apache-2.0
#include "eval/auto/residual_parts.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

#include "eval/auto/photograph.h"
#include "eval/metrics/quantize.h"
#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/camera_params.h"
#include "tests/kernels/backends.h"

namespace gs {
namespace {

constexpr int kSize = 100;
const Vec3<float> kBackground{0, 0, 0};

/// Returns photograph `k` of a spiral around the origin, at which it looks from 4 units away.
Photograph photograph_from(int k, int count) {
    const double height = 0.2 + 0.6 * k / count, angle = 2.4 * k;
    const Eigen::Vector3d at = 4 * Eigen::Vector3d(std::sqrt(1 - height * height) * std::cos(angle),
                                                   std::sqrt(1 - height * height) * std::sin(angle), height);
    const Eigen::Vector3d z = -at.normalized(), x = z.cross(Eigen::Vector3d::UnitZ()).normalized(), y = z.cross(x);
    Photograph p;
    p.camera.width = p.camera.height = kSize;
    p.camera.fx = p.camera.fy = kSize, p.camera.cx = p.camera.cy = kSize / 2.0;
    p.camera.rotation << x.transpose(), y.transpose(), z.transpose();
    p.camera.translation = -p.camera.rotation * at;
    for (int i = 0; i < kSize * kSize; ++i) p.pixels.push_back(i);
    p.colors = {};
    p.colors.width = kSize * kSize, p.colors.height = 1, p.colors.channels = 3;
    return p;
}

/// A ball of opaque Gaussians of half red, half green and no blue.
Gaussians ball() {
    Gaussians g;
    g.count = 400;
    g.appearance = {"none", 0, ColorActivation::kRelu};
    for (int k = 0; k < kNumGroups; ++k) {
        g.groups[k].width = group_width(Group(k), g.appearance);
        g.groups[k].param.resize(std::size_t(g.count * g.groups[k].width));
    }
    for (std::int64_t i = 0; i < g.count; ++i) {
        const double z = 1 - (2 * double(i) + 1) / double(g.count), r = std::sqrt(1 - z * z),
                     angle = 2.399963 * double(i);
        const double mean[3] = {r * std::cos(angle), r * std::sin(angle), z};
        for (int a = 0; a < 3; ++a)
            g[Group::kMean].param[std::size_t(3 * i + a)] = float(mean[a]),
                                                      g[Group::kScale].param[std::size_t(3 * i + a)] = -2.3f;
        g[Group::kRotation].param[std::size_t(4 * i)] = 1;
        g[Group::kOpacity].param[std::size_t(i)] = 6, g[Group::kBase].param[std::size_t(3 * i + 2)] = -0.5f;
    }
    return g;
}

/// Returns the parts of the ball's errors against photographs in which red and green of every Gaussian are brighter by
/// `color(photograph, camera position, mean)`. Ball and photographs are corrected by `ppisp`.
ResidualParts parts_of(
    const std::function<double(int photograph, const Eigen::Vector3d& camera, const Eigen::Vector3d& mean)>& color,
    const PpispState& ppisp = {}) {
    Gaussians plain = ball();
    plain.ppisp = ppisp;
    const auto colors = make_cpu_backend(plain.appearance, {}), positions = make_cpu_backend(plain.appearance, {});
    std::vector<Photograph> seen, held_out;
    constexpr int kCount = 48;
    for (int k = 0; k < kCount; ++k) {
        Photograph p = photograph_from(k, kCount);
        Gaussians shown = plain;
        for (std::int64_t i = 0; i < plain.count; ++i) {
            const float* m = plain[Group::kMean].param.data() + 3 * i;
            for (int c = 0; c < 2; ++c)
                shown[Group::kBase].param[std::size_t(3 * i + c)] =
                    float(color(k, p.camera.center(), {m[0], m[1], m[2]}));
        }
        colors->upload(shown);
        RenderedImage render;
        colors->render({.camera = camera_params(p.camera), .background = kBackground, .isp = {.mode = IspMode::kFrame}},
                       render);
        p.colors.u8 = quantized_render(render).u8;
        (k % 8 == 4 ? held_out : seen).push_back(std::move(p));
    }
    colors->upload(plain);
    return residual_parts(*colors, *positions, seen, held_out, kBackground);
}

double soft_highlight(int, const Eigen::Vector3d& camera, const Eigen::Vector3d& mean) {
    const double towards = std::max(0.0, (camera - mean).normalized().dot(Eigen::Vector3d(0.6, 0, 0.8)));
    return 0.4 * std::pow(towards, 6);
}

TEST(ResidualParts, FindsWhatDependsOnTheDirection) {
    const ResidualParts parts = parts_of(soft_highlight);
    EXPECT_GT(parts.direction, 0.3) << "the means of places and of images take the rest";
    EXPECT_GT(parts.held_out_direction, 0.3);
}

TEST(ResidualParts, TheCorrectionOfColoursMovesNoPlace) {
    PpispState dim = identity_ppisp(1, 1);
    dim.param[dim.camera_offset(0) + 2 * kIspVignetting + 2] =
        -4;  // towards the borders, in blue, of which nothing is seen
    const ResidualParts plain = parts_of(soft_highlight), corrected = parts_of(soft_highlight, dim);
    EXPECT_NEAR(corrected.direction, plain.direction, 1e-6);
    EXPECT_NEAR(corrected.held_out_direction, plain.held_out_direction, 1e-6);
}

TEST(ResidualParts, DetailOfTheSurfaceIsNoDirection) {
    const ResidualParts parts = parts_of([](int, const Eigen::Vector3d&, const Eigen::Vector3d& mean) {
        return 0.3 * std::sin(9 * mean.x()) * std::sin(11 * mean.y());
    });
    EXPECT_LT(std::abs(parts.direction), 0.05);
    EXPECT_LT(std::abs(parts.held_out_direction), 0.05);
}

TEST(ResidualParts, ChanceIsNoDirection) {
    const ResidualParts parts = parts_of([](int k, const Eigen::Vector3d&, const Eigen::Vector3d& mean) {
        const int octant = (mean.x() > 0) + 2 * (mean.y() > 0) + 4 * (mean.z() > 0);
        return 0.3 *
               (uniform_from_bits(philox(0, RngStream::kBackground, std::uint64_t(8 * k + octant), 0).v[0]) - 0.5);
    });
    EXPECT_LT(parts.direction, 0.05);
    EXPECT_LT(parts.held_out_direction, 0.05);
}

TEST(ResidualParts, ExposureIsPhotometric) {
    const ResidualParts parts =
        parts_of([](int k, const Eigen::Vector3d&, const Eigen::Vector3d&) { return 0.15 * (k % 3 - 1); });
    EXPECT_GT(parts.photometric, 0.9);
}

TEST(ResidualParts, WhatHeldOutImagesContradictIsBelowZero) {
    const ResidualParts parts = parts_of([](int k, const Eigen::Vector3d& camera, const Eigen::Vector3d& mean) {
        const double slope =
            0.3 * (camera - mean).normalized().dot(Eigen::Vector3d(0.6, 0, 0.8)) * (mean.x() > 0 ? 1 : -1);
        return k % 8 == 4 ? -slope : slope;
    });
    EXPECT_GT(parts.direction, 0.2);
    EXPECT_LT(parts.held_out_direction, -0.2);
}

/// Returns the parts of a model without Gaussians against photographs of one value.
ResidualParts parts_of_nothing(std::uint8_t value) {
    Gaussians nothing = ball();
    nothing.count = 0;
    for (auto& group : nothing.groups) group.param.clear();
    const auto colors = make_cpu_backend(nothing.appearance, {}), positions = make_cpu_backend(nothing.appearance, {});
    colors->upload(nothing);
    Photograph p = photograph_from(0, 1);
    p.colors.u8.assign(3 * p.pixels.size(), value);
    return residual_parts(*colors, *positions, {p}, {p}, kBackground);
}

TEST(ResidualParts, AreZeroWhereNothingIsThere) {
    const ResidualParts parts = parts_of_nothing(0);
    EXPECT_EQ(parts.direction, 0);
    EXPECT_EQ(parts.held_out_direction, 0);
    EXPECT_EQ(parts.photometric, 0);
}

TEST(ResidualParts, AllIsPhotometricWhereTheFitLeavesNothing) { EXPECT_EQ(parts_of_nothing(255).photometric, 1); }

/// Returns a view of 4x2 pixels of one colour; the first `masked` do not count.
View view(std::uint8_t value, int masked) {
    View v;
    v.camera.width = 4, v.camera.height = 2;
    v.camera.fx = v.camera.fy = 4, v.camera.cx = 2, v.camera.cy = 1;
    v.load = [value, masked] {
        ViewImage image;
        image.color.width = 4, image.color.height = 2, image.color.channels = 3;
        image.color.u8.assign(24, value);
        if (masked > 0) {
            image.mask.emplace();
            image.mask->width = 4, image.mask->height = 2, image.mask->channels = 1;
            image.mask->u8.assign(8, 255);
            for (int i = 0; i < masked; ++i)
                image.mask->u8[std::size_t(i)] = 127, image.color.u8[std::size_t(3 * i)] = 255;
        }
        return image;
    };
    return v;
}

TEST(Photograph, LeavesOutWhatItsMaskDoes) {
    const std::vector<Photograph> photographs = load_photographs({view(51, 3), view(51, 8), view(51, 0)}, {0, 0, 0});
    ASSERT_EQ(photographs.size(), 2u) << "nothing of the second counts";
    EXPECT_EQ(photographs[0].pixels, (std::vector<std::int32_t>{3, 4, 5, 6, 7}));
    EXPECT_EQ(photographs[1].pixels.size(), 8u);
    const AppearanceSpec none{"none", 0, ColorActivation::kRelu};
    const auto backend = make_cpu_backend(none, {});
    Gaussians nothing;
    nothing.appearance = none;
    for (int k = 0; k < kNumGroups; ++k) nothing.groups[k].width = group_width(Group(k), none);
    backend->upload(nothing);
    const RenderedImage pixels = render_pixels(*backend, photographs[0], {0, 0, 0});
    EXPECT_EQ(pixels.width, 5);
    EXPECT_NEAR(mean_squared_error(pixels, photographs[0]), 0.04, 1e-12) << "pixels that do not count would add to it";
    EXPECT_NEAR(mean_psnr(*backend, photographs, {0, 0, 0}, false), -10 * std::log10(0.04), 1e-9);
    EXPECT_NEAR(mean_psnr(*backend, photographs, {0, 0, 0}, true), 58.92, 0.01)
        << "a constant is what the fit takes off; the rest is less than rounding";
    EXPECT_NEAR(mean_psnr(*backend, load_photographs({view(0, 0)}, {0, 0, 0}), {0, 0, 0}, false), 58.92, 0.01)
        << "nothing, as it is seen";
    EXPECT_TRUE(std::isnan(mean_psnr(*backend, {}, {0, 0, 0}, false)));
}

TEST(Photograph, SaysWhichFileCannotBeRead) {
    View broken = view(0, 0);
    broken.load = []() -> ViewImage { throw DataError("image a.png: truncated"); };
    EXPECT_THROW(load_photographs({view(0, 0), broken}, {0, 0, 0}), DataError);
}

}  // namespace
}  // namespace gs
