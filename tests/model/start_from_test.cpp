// SPDX-License-Identifier: Apache-2.0
// A trained model as the beginning of another training: places, colours and residuals that stay, and what is refused.
#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/model/ply.h"
#include "lib/model/whole_model.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

/// A scene of one camera, in a frame.
Scene scene_in(const Frame& frame) {
    Scene scene;
    scene.frame = frame;
    scene.train.resize(1);
    scene.train[0].camera.translation = {0.3, -0.2, 9};
    return scene;
}

/// Writes a model and begins with it.
Gaussians begun(const Gaussians& g, const AppearanceSpec& appearance, const Frame& file = {}, const Frame& now = {}) {
    const TempFolder folder;
    write_ply(folder / "p.ply", g, {.frame = file});
    return start_from(read_initial_model(folder / "p.ply"), scene_in(now), appearance, 1);
}

/// Returns the colour of a Gaussian as the camera of scene_in() sees it.
Vec3<double> seen_color(const Gaussians& g, std::int64_t i) {
    const float* base = &g[Group::kBase].param[3 * std::size_t(i)];
    Vec3<double> y{base[0], base[1], base[2]};
    const int width = g[Group::kResidual].width;
    if (i < g.num_residuals()) {
        const Eigen::Vector3d at = Eigen::Vector3f::Map(&g[Group::kMean].param[3 * std::size_t(i)]).cast<double>(),
                              d = (at - scene_in({}).train[0].camera.center()).normalized();
        const float* row = g[Group::kResidual].param.data() + i * width;
        const std::vector<double> params(row, row + width), shared(g.shared.param.begin(), g.shared.param.end());
        y = y + appearance_model(g.appearance.model)
                    .residual(shared.data(), params.data(), {d.x(), d.y(), d.z()}, g.appearance.max_degree);
    }
    return activate(g.appearance.activation, y);
}

/// A PLY holds the base over Y0, which rounds it.
void expect_same_bases(const Gaussians& a, const Gaussians& b) {
    ASSERT_EQ(a[Group::kBase].param.size(), b[Group::kBase].param.size());
    for (std::size_t i = 0; i < a[Group::kBase].param.size(); ++i)
        EXPECT_FLOAT_EQ(a[Group::kBase].param[i], b[Group::kBase].param[i]);
}

class StartFrom : public ::testing::TestWithParam<const ModelInfo*> {
  protected:
    AppearanceSpec spec() const { return {GetParam()->name, GetParam()->default_max_degree, ColorActivation::kRelu}; }
};
INSTANTIATE_TEST_SUITE_P(All, StartFrom, ::testing::ValuesIn(appearance_models()),
                         [](const auto& info) { return info.param->name; });

TEST_P(StartFrom, TheSameModelGoesOn) {
    const Gaussians g = random_gaussians(7, spec()), out = begun(g, spec());
    EXPECT_EQ(out.count, 7);
    EXPECT_EQ(out.active_degree, spec().max_degree);
    expect_same_bases(out, g);
    EXPECT_EQ(out[Group::kResidual].param, g[Group::kResidual].param);
    EXPECT_EQ(out.shared.param, g.shared.param);
    EXPECT_TRUE(out[Group::kMean].m.empty()) << "without moments";
}

TEST_P(StartFrom, AnotherModelBeginsWithTheColoursThatWereSeen) {
    // Colours in the open interval that every activation reaches.
    Gaussians g = random_gaussians(20, {"sh", 2, ColorActivation::kRelu});
    for (float& x : g[Group::kBase].param) x = std::clamp(x, -0.3f, 0.3f);
    for (float& x : g[Group::kResidual].param) x = std::clamp(0.02f * x, -0.02f, 0.02f);
    for (const ColorActivation activation : {ColorActivation::kRelu, ColorActivation::kSigmoid}) {
        AppearanceSpec wanted = spec();
        wanted.activation = activation;
        if (GetParam()->plain_sh && activation == ColorActivation::kRelu) continue;  // below
        const Gaussians out = begun(g, wanted);
        EXPECT_EQ(out.appearance.model, wanted.model);
        EXPECT_EQ(out.num_residuals(), group_width(Group::kResidual, wanted) > 0 ? 20 : 0);
        EXPECT_EQ(int(out.shared.param.size()), GetParam()->num_shared);
        for (std::int64_t i = 0; i < out.count; ++i) {
            const Vec3<double> before = seen_color(g, i), after = seen_color(out, i);
            EXPECT_NEAR(before.x, after.x, 2e-6);
            EXPECT_NEAR(before.y, after.y, 2e-6);
            EXPECT_NEAR(before.z, after.z, 2e-6);
        }
    }
}

TEST(StartFromSh, KeepsTheBandsThatBothHave) {
    const Gaussians g = random_gaussians(5, {"sh", 2, ColorActivation::kRelu});
    const int had = g[Group::kResidual].width;
    for (const int degree : {1, 3}) {
        const Gaussians out = begun(g, {"sh", degree, ColorActivation::kRelu});
        EXPECT_EQ(out.active_degree, degree);
        const int width = out[Group::kResidual].width;
        for (int i = 0; i < 5; ++i)
            for (int k = 0; k < width; ++k)
                EXPECT_EQ(out[Group::kResidual].param[std::size_t(i * width + k)],
                          k < had ? g[Group::kResidual].param[std::size_t(i * had + k)] : 0.0f);
    }
    const Gaussians plain = random_gaussians(5, {"none", 0, ColorActivation::kRelu});
    const Gaussians out = begun(plain, {"sh", 3, ColorActivation::kRelu});
    EXPECT_EQ(out[Group::kResidual].param, std::vector<float>(5 * 45));
    expect_same_bases(out, plain);
}

TEST(StartFromFrame, PlacesAreThoseOfTheScene) {
    const Gaussians g = random_gaussians(9, {"none", 0, ColorActivation::kRelu});
    const Frame file{{1, -2, 3}, 4}, now{{-5, 0.5, 2}, 0.25};
    Gaussians expected = begun(g, g.appearance, file, Frame{});  // scene coordinates
    bring_into_frame(expected, now);
    const Gaussians out = begun(g, g.appearance, file, now);
    for (std::size_t i = 0; i < out[Group::kMean].param.size(); ++i) {
        EXPECT_NEAR(out[Group::kMean].param[i], expected[Group::kMean].param[i], 1e-5);
        EXPECT_NEAR(out[Group::kScale].param[i], expected[Group::kScale].param[i], 1e-5);
    }
}

TEST(StartFromFile, InfiniteParametersBeginAsFiniteOnes) {
    Gaussians g = random_gaussians(3, {"none", 0, ColorActivation::kRelu});
    const float infinity = std::numeric_limits<float>::infinity(), untouched = g[Group::kScale].param[0];
    g[Group::kOpacity].param = {infinity, -infinity, 2};
    g[Group::kScale].param[8] = -infinity;
    const Gaussians out = begun(g, g.appearance);
    EXPECT_GT(sigmoid(double(out[Group::kOpacity].param[0])), 0.999);
    EXPECT_LT(out[Group::kOpacity].param[0], 17) << "there would be no gradient";
    EXPECT_LT(sigmoid(double(out[Group::kOpacity].param[1])), 1.0 / 255);
    EXPECT_EQ(out[Group::kOpacity].param[2], 2);
    EXPECT_EQ(out[Group::kScale].param[0], untouched);
    EXPECT_EQ(out[Group::kScale].param[8], -12);
}

TEST(StartFromFile, WhatCannotBeginIsNamed) {
    const TempFolder folder;
    const AppearanceSpec none{"none", 0, ColorActivation::kRelu};
    EXPECT_THROW(read_initial_model(folder / "p.splat"), UsageError);
    EXPECT_THROW(read_initial_model(folder / "missing.ply"), DataError);
    spit(folder / "p.spz", "NGSP");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_initial_model(folder / "p.spz"); }), "splat-transform");
    spit(folder / "sog" / "meta.json", R"({"means":{},"quats":{}})");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_initial_model(folder / "sog"); }), "splat-transform");
    std::filesystem::create_directory(folder / "run");
    EXPECT_THROW(read_initial_model(folder / "run"), DataError);
    write_ply(folder / "empty.ply", random_gaussians(0, none), {});
    EXPECT_THROW(read_initial_model(folder / "empty.ply"), DataError);
}

}  // namespace
}  // namespace gs::test
