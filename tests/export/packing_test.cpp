// SPDX-License-Identifier: Apache-2.0
// What is packed shows what the model shows: every model, its parameters and its extremes.
#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "appearance/contract.h"
#include "appearance/neural/neural.h"
#include "kernels/base/error.h"
#include "kernels/ppisp/ppisp_device.h"
#include "lib/export/file_rows.h"
#include "lib/export/pack_scene.h"
#include "lib/export/packed_model.h"
#include "lib/model/whole_model.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

/// Draws random directions.
class Directions {
  public:
    Vec3<double> next() {
        const Vec3<double> v{normal_(random_), normal_(random_), normal_(random_)};
        return v * (1 / std::sqrt(dot(v, v)));
    }

  private:
    std::mt19937 random_{5};
    std::normal_distribution<double> normal_;
};

Vec3<double> exact_residual(const Gaussians& g, std::int64_t row, const Vec3<double>& d) {
    const auto& residual = g[Group::kResidual];
    const std::vector<double> params(residual.param.begin() + row * residual.width,
                                     residual.param.begin() + (row + 1) * residual.width);
    const std::vector<double> shared(g.shared.param.begin(), g.shared.param.end());
    return appearance_model(g.appearance.model).residual(shared.data(), params.data(), d, g.active_degree);
}

double largest(const Vec3<double>& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// Returns Gaussians with parameters of usual size: lobes of a sharpness that pictures show, amplitudes and weights
/// below 1.
Gaussians usual_gaussians(const ModelInfo& model, int active_degree) {
    Gaussians g = random_gaussians(50, {model.name, model.default_max_degree, ColorActivation::kRelu});
    g.active_degree = active_degree;
    for (float& x : g[Group::kResidual].param) x *= 0.3f;
    for (float& x : g.shared.param) x *= 0.3f;
    return g;
}

TEST(Packing, ShowsTheResidualAtEveryDegree) {
    for (const ModelInfo* model : appearance_models()) {
        for (int degree = 0; degree <= model->default_max_degree; ++degree) {
            SCOPED_TRACE(model->name + " at degree " + std::to_string(degree));
            const Gaussians g = usual_gaussians(*model, degree);
            const PackedScene scene = pack_gaussians(g);
            Directions directions;
            double worst = 0;
            for (std::int64_t i = 0; i < g.count; ++i) {
                for (int k = 0; k < 20; ++k) {
                    const Vec3<double> d = directions.next();
                    worst = std::max(
                        worst, largest(model->packing->residual(scene.appearance, i, d) - exact_residual(g, i, d)));
                }
            }
            // Halves: a few units of 2^-11. SH: half a step of each coefficient, 15 of them, of bands that reach
            // about 1.2.
            EXPECT_LE(worst, scene.appearance.header.model == packing_description("sh").id ? 0.12 : 5e-3);
            if (degree == 0) {
                EXPECT_EQ(worst, 0);
            }
        }
    }
}

TEST(Packing, NetworksFoldedOrNotAreTheNetwork) {
    // The folded layer and the full one, against the network in double with its weights rounded once.
    for (const char* name : {"neural", "neural_wide"}) {
        if (!has_model(name)) continue;
        Gaussians g = usual_gaussians(appearance_model(name), 3);
        for (float& x : g.shared.param) x = float(half_value(half_bits(x)));
        const PackedScene scene = pack_gaussians(g);
        EXPECT_EQ(scene.appearance.header.folded, std::string(name) == "neural");
        Directions directions;
        for (std::int64_t i = 0; i < g.count; ++i) {
            const Vec3<double> d = directions.next();
            EXPECT_LE(
                largest(appearance_model(name).packing->residual(scene.appearance, i, d) - exact_residual(g, i, d)),
                1e-3);
        }
    }
}

TEST(Packing, WeightsLieFourInputsToATexelAllOutputsFirst) {
    using Model = appearance::Neural;
    Gaussians g = usual_gaussians(appearance_model("neural"), 3);
    const std::vector<std::uint16_t> stream = pack_gaussians(g).appearance.weights;
    ASSERT_EQ(stream.size(), 4u * 140);
    const auto half_of = [&](int at) { return half_bits(g.shared.param[std::size_t(at)]); };
    const int first = Model::kEncoded + 1;                 // of the inputs that are not folded
    EXPECT_EQ(stream[0], half_of(first * 16));             // output 0, input 0
    EXPECT_EQ(stream[1], half_of((first + 1) * 16));       // output 0, input 1
    EXPECT_EQ(stream[4], half_of(first * 16 + 1));         // output 1, input 0
    EXPECT_EQ(stream[4 * 16], half_of((first + 4) * 16));  // output 0, input 4
    EXPECT_EQ(stream[4 * 48 + 3], 0) << "15 directional inputs, padded to 16";
    EXPECT_EQ(stream[4 * 64 + 2], half_of(Model::matrix(1) + 2 * 16));  // second layer, output 0, input 2
    EXPECT_EQ(stream[4 * 128 + 4 * 3 + 4 + 1], half_of(Model::kFirstOutput + 16 + 5));  // last layer, output 1, input 5
}

TEST(Packing, ExtremeLobesStayFiniteAndKeepTheirPeak) {
    Gaussians g = usual_gaussians(appearance_model("nasg"), 1);
    float* raw = g[Group::kResidual].param.data();
    for (int k = 0; k < 3; ++k) raw[k] = 0.4f;
    raw[3] = raw[4] = 100;  // beyond all limits: N = 1.6e5
    raw[5] = 0.001f, raw[6] = -30, raw[7] = 0.1f;
    for (int k = 8; k < 16; ++k) raw[k] = k % 2 ? -1e30f : 1e30f;
    const PackedScene scene = pack_gaussians(g);
    const Vec3<double> axis{get_half(scene.appearance, 0, 3), get_half(scene.appearance, 0, 4),
                            get_half(scene.appearance, 0, 5)};
    const Vec3<double> d = axis * (1 / std::sqrt(dot(axis, axis)));
    const Packing& packing = *appearance_model("nasg").packing;
    const Vec3<double> peak = packing.residual(scene.appearance, 0, d);
    const double norm = std::sqrt(1 + 1e4) * 1e4 / (2 * M_PI);
    EXPECT_NEAR(peak.x / (norm * std::tanh(0.001)), 1, 2e-3);
    EXPECT_NEAR(peak.y / (norm * std::tanh(-30.0)), 1, 2e-3);
    for (const Vec3<double>& at : {d, d * -1.0, Vec3<double>{0, 0, 1}, Vec3<double>{0, 1, 0}, Vec3<double>{1, 0, 0}}) {
        for (std::int64_t i = 0; i < 2; ++i)
            EXPECT_TRUE(std::isfinite(largest(packing.residual(scene.appearance, i, at))));
    }
}

TEST(Packing, LobesAreContinuousAroundTheirAxis) {
    // Axes rounded to halves are not of unit length: the value at the axis must still be the limit of those around it.
    const Gaussians g = usual_gaussians(appearance_model("nasg"), 1);
    const PackedScene scene = pack_gaussians(g);
    const Packing& packing = *appearance_model("nasg").packing;
    for (std::int64_t i = 0; i < g.count; ++i) {
        const Vec3<double> stored{get_half(scene.appearance, i, 3), get_half(scene.appearance, i, 4),
                                  get_half(scene.appearance, i, 5)};
        const Vec3<double> axis = stored * (1 / std::sqrt(dot(stored, stored))), aside = cross(axis, {0.6, 0, 0.8});
        for (const double s : {1e-4, 1e-3}) {
            const Vec3<double> near = axis + aside * s;
            const Vec3<double> change = packing.residual(scene.appearance, i, near * (1 / std::sqrt(dot(near, near)))) -
                                        packing.residual(scene.appearance, i, axis);
            EXPECT_LE(largest(change), 10 * s);
        }
    }
}

TEST(PackScene, ColoursAreTheModelsWithinTheRoundingOfTheBase) {
    for (int activation = 0; activation < 4; ++activation) {
        Gaussians g = random_gaussians(100, {"none", 0, ColorActivation(activation)});
        const PackedScene scene = pack_gaussians(g);
        for (std::int64_t i = 0; i < g.count; ++i) {
            const float* base = g[Group::kBase].param.data() + 3 * i;
            const Vec3<double> color = packed_color(scene, i, {0, 0, 1});
            EXPECT_NEAR(color.x, color_activation(ColorActivation(activation), double(base[0])),
                        0.51 * scene.base_range.scale);
            EXPECT_NEAR(color.z, color_activation(ColorActivation(activation), double(base[2])),
                        0.51 * scene.base_range.scale);
        }
    }
}

TEST(PackScene, DecodedGeometryIsThatOfTheModel) {
    Gaussians g = random_gaussians(50, {"none", 0, ColorActivation::kRelu});
    EXPECT_FALSE(packed_geometry(pack_gaussians(g)).antialiased);
    g.antialiased = true;
    const Gaussians back = packed_geometry(pack_gaussians(g));
    EXPECT_TRUE(back.antialiased);
    ASSERT_EQ(back.count, g.count);
    for (std::size_t k = 0; k < g[Group::kMean].param.size(); ++k)
        EXPECT_NEAR(back[Group::kMean].param[k], g[Group::kMean].param[k],
                    4.9e-4 * std::max(1.0f, std::abs(g[Group::kMean].param[k])));
    // Where the ellipsoid has its surface in some directions, whatever describes it.
    const auto radius = [](const Gaussians& of, std::int64_t i, const Eigen::Vector3d& direction) {
        const float *q = of[Group::kRotation].param.data() + 4 * i, *s = of[Group::kScale].param.data() + 3 * i;
        const Eigen::Vector3d local = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().conjugate() * direction;
        return local.cwiseProduct(Eigen::Vector3d(std::exp(s[0]), std::exp(s[1]), std::exp(s[2]))).norm();
    };
    for (std::int64_t i = 0; i < g.count; ++i) {
        for (const Eigen::Vector3d& axis :
             {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, 0, 1)})
            EXPECT_NEAR(radius(back, i, axis) / radius(g, i, axis), 1, 0.043 + 0.02)
                << "half a step of scales, and of the rotation";
        const double opacity = sigmoid(double(g[Group::kOpacity].param[std::size_t(i)]));
        EXPECT_NEAR(sigmoid(double(back[Group::kOpacity].param[std::size_t(i)])), opacity, 0.51 / 255 + 0.043 * opacity)
            << "half of what two scales gain";
    }
}

TEST(PackScene, CompletedResidualsShowNothing) {
    for (const ModelInfo* model : appearance_models()) {
        SCOPED_TRACE(model->name);
        Gaussians g = random_gaussians(6, {model->name, model->default_max_degree, ColorActivation::kRelu});
        g.active_degree = g.appearance.max_degree;
        const int width = g[Group::kResidual].width;
        if (width == 0) continue;
        g[Group::kResidual].param.resize(std::size_t(2 * width));
        Gaussians complete = g;
        if (model->num_shared > 0) {
            EXPECT_THROW(complete_residuals(complete), UsageError);
            continue;
        }
        complete_residuals(complete);
        EXPECT_EQ(complete.num_residuals(), 6);
        const PackedScene a = pack_gaussians(g), b = pack_gaussians(complete);
        for (std::int64_t i = 0; i < 6; ++i) {
            const Vec3<double> x = packed_color(a, i, {0, 0.6, 0.8}), y = packed_color(b, i, {0, 0.6, 0.8});
            EXPECT_NEAR(x.x, y.x, 2e-3) << i;
            EXPECT_NEAR(x.z, y.z, 2e-3) << i;
        }
    }
}

TEST(PackScene, ScalesBeyondTheCodesLeaveTheOpacityAlone) {
    Gaussians g = random_gaussians(3, {"none", 0, ColorActivation::kRelu});
    g[Group::kScale].param = {-20, -25, -30, 30, 38, 39, -1e30f, -1e30f, -1e30f};
    g[Group::kOpacity].param = {0, 0, 0};
    const Gaussians back = packed_geometry(pack_gaussians(g));
    for (const float raw : back[Group::kOpacity].param) EXPECT_NEAR(sigmoid(double(raw)), 0.5, 0.51 / 255);
}

TEST(PackScene, WhatIsNeverSeenIsLeftOut) {
    Gaussians g = random_gaussians(5, {"sh", 1, ColorActivation::kRelu});
    g[Group::kOpacity].param = {0, -5.6f, -5.5f, 0, 10};  // 1/255 is -5.537
    std::fill_n(g[Group::kRotation].param.begin() + 12, 4, 0.0f);
    const Gaussians seen = visible_gaussians(g);
    ASSERT_EQ(seen.count, 3);
    EXPECT_EQ(seen[Group::kOpacity].param, (std::vector<float>{0, -5.5f, 10}));
    EXPECT_TRUE(std::equal(seen[Group::kResidual].param.begin() + 9, seen[Group::kResidual].param.begin() + 18,
                           g[Group::kResidual].param.begin() + 18));
    g[Group::kOpacity].param.assign(5, -100);
    EXPECT_EQ(pack_gaussians(visible_gaussians(g)).count(), 0);
}

/// Returns what orders a Gaussian, written without the approximation of its area: that of balls is exact.
double weight_of_ball(const Gaussians& g, std::int64_t i) {
    return sigmoid(double(g[Group::kOpacity].param[std::size_t(i)])) *
           std::exp(double(g[Group::kScale].param[std::size_t(3 * i)]));
}

TEST(PackScene, ScoresDecideWhereThereAreAny) {
    Gaussians g = random_gaussians(64, {"none", 0, ColorActivation::kRelu});
    std::vector<float> scores(64);
    for (std::size_t i = 0; i < 64; ++i) {
        g[Group::kMean].param[3 * i] = float(i), g[Group::kOpacity].param[i] = 0;
        scores[i] = float((i * 37) % 64);
    }
    scores[5] = INFINITY;
    g[Group::kOpacity].param[6] = -20;
    order_by_importance(g, scores);
    for (std::int64_t k = 0; k < kImportanceClasses; ++k) {
        for (std::int64_t row = class_begin(64, k); row < class_begin(64, k + 1); ++row) {
            const auto was = std::size_t(g[Group::kMean].param[std::size_t(3 * row)]);
            if (was == 5)
                EXPECT_EQ(k, 0);
            else if (was == 6)
                EXPECT_EQ(k, kImportanceClasses - 1) << "what is hardly opaque hardly shows";
            else
                EXPECT_NEAR(double(scores[was]), double(63 - row), 6);
        }
    }
}

TEST(PackScene, ImportantGaussiansComeFirstAndClassesKeepTheirOrder) {
    for (const ModelInfo* model : appearance_models()) {
        for (const std::int64_t mixed : {std::int64_t(0), std::int64_t(40)}) {
            SCOPED_TRACE(model->name + " with " + std::to_string(mixed));
            Gaussians g = random_gaussians(200, {model->name, model->default_max_degree, ColorActivation::kRelu});
            GroupArrays<float>& residuals = g[Group::kResidual];
            if (mixed > 0 && residuals.width == 0) continue;
            if (mixed > 0) residuals.param.resize(std::size_t(mixed * residuals.width));
            for (std::int64_t i = 0; i < g.count; ++i) {
                const float size = float((i * 37) % 101) / 20 - 5;
                std::fill_n(g[Group::kScale].param.begin() + 3 * i, 3, size);
                g[Group::kMean].param[std::size_t(3 * i)] = float(i);  // says which row it was
            }
            Gaussians ordered = g;
            order_by_importance(ordered);
            ASSERT_EQ(ordered.count, 200);
            ASSERT_EQ(ordered.num_residuals(), g.num_residuals());
            std::vector<bool> seen(200);
            for (const auto& [begin, end] : {std::pair{std::int64_t(0), mixed}, std::pair{mixed, std::int64_t(200)}}) {
                double least = INFINITY;
                for (std::int64_t k = 0; k < kImportanceClasses; ++k) {
                    double next = INFINITY;
                    std::int64_t before = -1;
                    const std::int64_t first = begin + class_begin(end - begin, k),
                                       last = begin + class_begin(end - begin, k + 1);
                    for (std::int64_t row = first; row < last; ++row) {
                        const auto was = std::int64_t(ordered[Group::kMean].param[std::size_t(3 * row)]);
                        EXPECT_TRUE(was >= begin && was < end);
                        EXPECT_GT(was, before) << "rows of a class keep their order";
                        EXPECT_LE(weight_of_ball(g, was), least * (1 + 1e-9));
                        before = was, seen[std::size_t(was)] = true, next = std::min(next, weight_of_ball(g, was));
                        for (int group = 0; group < kNumGroups; ++group) {
                            const auto &a = g.groups[group], &b = ordered.groups[group];
                            if (row >= g.num_rows(Group(group))) continue;
                            EXPECT_TRUE(std::equal(a.param.begin() + was * a.width,
                                                   a.param.begin() + (was + 1) * a.width,
                                                   b.param.begin() + row * b.width));
                        }
                    }
                    if (last > first) least = next;
                }
            }
            EXPECT_EQ(std::count(seen.begin(), seen.end(), true), 200);
            EXPECT_EQ(ordered.shared.param, g.shared.param);
        }
    }
}

TEST(PackScene, EquallyImportantGaussiansKeepTheirOrder) {
    Gaussians g = random_gaussians(20, {"sh", 1, ColorActivation::kRelu});
    std::fill(g[Group::kScale].param.begin(), g[Group::kScale].param.end(), -2.0f);
    std::fill(g[Group::kOpacity].param.begin(), g[Group::kOpacity].param.end(), 1.0f);
    const std::vector<float> means = g[Group::kMean].param;
    order_by_importance(g);
    EXPECT_EQ(g[Group::kMean].param, means);
    Gaussians none = random_gaussians(0, {"sh", 1, ColorActivation::kRelu});
    order_by_importance(none);
    EXPECT_EQ(none.count, 0);
}

TEST(PackScene, ValuesThatAreNotFiniteFailTheExport) {
    const Gaussians good = random_gaussians(3, {"neural", 3, ColorActivation::kRelu});
    require_finite(good);
    for (const float bad : {NAN, INFINITY}) {
        for (int k = 0; k < kNumGroups; ++k) {
            if (has_meaning(Group(k), bad) || good.groups[k].width == 0) continue;  // an opacity of 1
            Gaussians g = good;
            g.groups[k].param.back() = bad;
            EXPECT_CONTAINS(message_of<DataError>([&] { require_finite(g); }),
                            std::string("Gaussian 2 has ") + kGroupNames[std::size_t(k)]);
        }
        Gaussians g = good;
        g.shared.param[7] = bad;
        EXPECT_CONTAINS(message_of<DataError>([&] { require_finite(g); }), "shared weight 7");
    }
}

TEST(PackScene, FirstViewLooksAtTheMiddleFromWhereCamerasStand) {
    Gaussians g = random_gaussians(3, {"none", 0, ColorActivation::kRelu});
    g[Group::kMean].param = {0, 0, 0, 1, 1, 1, 100, 200, 300};
    PackedScene scene = pack_gaussians(g);
    View view;
    view.camera.width = 64, view.camera.fx = 50;
    view.camera.translation = {-1, -1, 4};  // at (1, 1, -4), looking along +z
    add_cameras(scene, g, {view});
    EXPECT_EQ(scene.center, (std::array<float, 3>{1, 1, 1}));
    EXPECT_EQ(scene.up, (std::array<float, 3>{0, -1, 0}));
    EXPECT_EQ(scene.distance, 5);
    EXPECT_EQ(scene.cameras[0].world_from_camera[11], -4);
    EXPECT_EQ(scene.cameras[0].fx, 50);
    PackedScene without = pack_gaussians(g);
    add_cameras(without, g, {});
    EXPECT_FLOAT_EQ(without.distance, 1.5f * std::sqrt(3.0f));
    PackedScene empty;
    add_cameras(empty, Gaussians{}, {});
    EXPECT_EQ(empty.distance, 1);
}

TEST(PackPpisp, ResponseIsTheCamerasAndTheMiddleExposureTheStandard) {
    PpispState state = identity_ppisp(3, 1);
    const float exposures[3] = {0.5f, -1, 0.25f};
    for (int f = 0; f < 3; ++f)
        state.param[std::size_t(f * kIspFrameValues)] = exposures[f],
                                    state.param[std::size_t(f * kIspFrameValues + 1)] = float(f);
    float* response = state.param.data() + state.camera_offset(0) + 3 * kIspVignetting;
    for (int k = 0; k < 3 * kIspResponse; ++k) response[k] += 0.1f * float(k - 5);
    const PackedPpisp packed = pack_ppisp(state);
    EXPECT_EQ(packed.standard[0], 0.25f);
    EXPECT_EQ(packed.standard[1], 2);
    const std::vector<double> raw(state.param.begin() + std::ptrdiff_t(state.camera_offset(0)), state.param.end());
    const IspCamera<double> camera = isp_camera(raw.data());
    for (int c = 0; c < 3; ++c) {
        const float* r = packed.response.data() + 6 * c;
        for (const double x : {0.01, 0.3, 0.5, 0.7, 0.99}) {
            const double y =
                x <= r[3] ? r[4] * std::pow(x / r[3], r[0]) : 1 - r[5] * std::pow((1 - x) / (1 - r[3]), r[1]);
            EXPECT_NEAR(std::pow(y, r[2]), isp_respond(camera.response[c], x), 1e-5);
        }
    }
    const RenderedImage image{8, 8, std::vector<float>(192, 0.5f), std::vector<float>(64, 1.0f)};
    EXPECT_EQ(packed_frame(state, {IspMode::kController}, image), PackedFrame{}) << "no controller";
    initialize_controller(state, 1);
    EXPECT_NE(packed_frame(state, {IspMode::kController}, image), PackedFrame{});
    EXPECT_EQ(packed_frame(state, {IspMode::kFrame}, image), PackedFrame{});
}

}  // namespace
}  // namespace gs::test
