// SPDX-License-Identifier: Apache-2.0
// Every registered model in the renderer: gradients through each colour activation, and the parts of a picture. Knows
// no model by name, so that it runs on any registry.
#include <gtest/gtest.h>

#include <string>

#include "appearance/model_info.h"
#include "kernels/cuda/cuda_device.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/gradient_check.h"
#include "tests/kernels/lenses.h"

#include "appearance_types.inc"

namespace gs::test {
namespace {

constexpr ColorActivation kActivations[] = {ColorActivation::kRelu, ColorActivation::kSoftplus,
                                            ColorActivation::kSigmoid, ColorActivation::kHardSigmoid};

/// Returns whether phi has a kink so near to y that the step of a finite difference may cross it.
bool near_kink(ColorActivation activation, double y) {
    constexpr double kMargin = 1e-3;
    const bool low = activation == ColorActivation::kRelu || activation == ColorActivation::kHardSigmoid;
    const bool high = activation == ColorActivation::kHardSigmoid;
    return (low && std::abs(y + 0.5) < kMargin) || (high && std::abs(y - 0.5) < kMargin);
}

template <class Model> class EveryModel : public ::testing::Test {
  protected:
    const ModelInfo& info = appearance_model(appearance_name(static_cast<const Model*>(nullptr)));

    /// Returns random Gaussians with the whole residual active and no colour near a kink from `camera`.
    GaussianState<double> random_model(std::int64_t n, ColorActivation activation, const CameraParams<double>& camera) {
        auto s = random_gaussians(n, 0, 31);
        s.appearance = {info.name, info.max_degree_limit, activation};
        s.active_degree = info.max_degree_limit;
        std::mt19937 rng(32);
        std::normal_distribution<double> normal;
        const int width = info.residual_width(info.max_degree_limit);
        s[Group::kResidual].width = width;
        s[Group::kResidual].param.resize(n * width);
        for (double& x : s[Group::kResidual].param) x = normal(rng);
        s.shared.width = info.num_shared;
        for (int k = 0; k < info.num_shared; ++k) s.shared.param.push_back(0.3 * normal(rng));
        for (std::int64_t i = 0; i < n; ++i) {
            const double* mean = &s[Group::kMean].param[3 * i];
            const auto direction = view_direction(Vec3<double>{mean[0], mean[1], mean[2]}, camera.position);
            const Vec3<double> r = model_residual<Model>(
                s.shared.param.data(), s[Group::kResidual].param.data() + i * width, direction.unit, s.active_degree);
            const double residual[3] = {r.x, r.y, r.z};
            for (int c = 0; c < 3; ++c) {
                double& base = s[Group::kBase].param[3 * i + c];
                while (near_kink(activation, base + residual[c])) base = 0.3 * normal(rng);
            }
        }
        return s;
    }
};
using AllModels = ::testing::Types<GS_ALL_APPEARANCE_MODELS>;
TYPED_TEST_SUITE(EveryModel, AllModels);

TYPED_TEST(EveryModel, RendersWithMatchingGradientsThroughEachActivation) {
    const auto camera = test_camera(20, 18);
    for (const ColorActivation activation : kActivations) {
        SCOPED_TRACE(int(activation));
        auto s = this->random_model(6, activation, camera);
        if (activation == ColorActivation::kSoftplus) s = antialiased(s);
        GradientCheck check;
        check.run<TypeParam>(s, camera, {0.1, 0.5, 0.9}, random_weights(3 * 20 * 18, 33));
        EXPECT_EQ(check.checked, s.count * (14 + s[Group::kResidual].width) + s.shared.width);
        EXPECT_GT(check.nonzero, check.checked / 3) << "most Gaussians are seen, and not all colours saturated";
    }
}

TYPED_TEST(EveryModel, RendersWithMatchingGradientsThroughALens) {
    const auto camera = lens_camera(test_lenses().front(), 20, 18);
    const auto s = this->random_model(6, ColorActivation::kSoftplus, camera);
    GradientCheck check;
    check.run<TypeParam>(s, camera, {0.1, 0.5, 0.9}, random_weights(3 * 20 * 18, 33));
    EXPECT_GT(check.nonzero, check.checked / 3);
    check.run<TypeParam>(antialiased(s), camera, {0.1, 0.5, 0.9}, random_weights(3 * 20 * 18, 33));
}

/// Renders the picture of one mode. A residual is a difference and stands before black.
std::vector<float> part(Backend& backend, const CameraParams<double>& camera, RenderMode mode) {
    RenderRequest request;
    request.camera = cast<float>(camera);
    if (mode != RenderMode::kResidualOnly) request.background = {0.3f, 0.6f, 0.1f};
    request.mode = mode;
    RenderedImage image;
    backend.render(request, image);
    return image.rgb;
}

TYPED_TEST(EveryModel, ResidualPictureIsTheDistanceOfTheFullFromTheBase) {
    const auto camera = test_camera(20, 18);
    double moved = 0;
    for (const ColorActivation activation : kActivations) {
        std::vector<std::unique_ptr<Backend>> backends;
        backends.push_back(make_cpu_backend({this->info.name, this->info.max_degree_limit, activation}));
        if (cuda_available())
            backends.push_back(make_cuda_backend({this->info.name, this->info.max_degree_limit, activation}));
        for (auto& backend : backends) {
            SCOPED_TRACE(backend->describe() + ", activation " + std::to_string(int(activation)));
            // One opaque Gaussian over the whole picture: the same weight everywhere, so equality.
            auto one = this->random_model(1, activation, camera);
            for (double& x : one[Group::kMean].param) x = 0;
            for (double& x : one[Group::kScale].param) x = 6;
            for (double& x : one[Group::kOpacity].param) x = 20;
            backend->upload(cast<float>(one));
            auto full = part(*backend, camera, RenderMode::kFull), base = part(*backend, camera, RenderMode::kBaseOnly),
                 residual = part(*backend, camera, RenderMode::kResidualOnly);
            for (std::size_t i = 0; i < full.size(); ++i) {
                EXPECT_NEAR(std::abs(full[i] - base[i]), residual[i], 2e-6f);
                moved += residual[i];
            }
            // The distances of several Gaussians add up, while opposite ones cancel in the full picture.
            backend->upload(cast<float>(this->random_model(6, activation, camera)));
            full = part(*backend, camera, RenderMode::kFull), base = part(*backend, camera, RenderMode::kBaseOnly),
            residual = part(*backend, camera, RenderMode::kResidualOnly);
            for (std::size_t i = 0; i < full.size(); ++i) EXPECT_LE(std::abs(full[i] - base[i]), residual[i] + 2e-6f);
            backend->set_active_degree(0);
            full = part(*backend, camera, RenderMode::kFull);
            for (std::size_t i = 0; i < full.size(); ++i) EXPECT_EQ(full[i], base[i]);
            for (const float x : part(*backend, camera, RenderMode::kResidualOnly))
                EXPECT_EQ(x, 0) << "degree 0 has no residual";
        }
    }
    EXPECT_EQ(moved > 0.01, TypeParam::kDirectional);
}

TYPED_TEST(EveryModel, AdcCopiesResidualsAndPruningByScoreMovesThem) {
    const auto camera = test_camera(20, 18);
    std::vector<std::unique_ptr<Backend>> backends;
    const AppearanceSpec appearance{this->info.name, this->info.max_degree_limit, ColorActivation::kRelu};
    backends.push_back(make_cpu_backend(appearance));
    if (cuda_available()) backends.push_back(make_cuda_backend(appearance));
    for (auto& backend : backends) {
        SCOPED_TRACE(backend->describe());
        Gaussians s = cast<float>(this->random_model(60, ColorActivation::kRelu, camera));
        s.gradient_sum.assign(60, 1.0f), s.gradient_count.assign(60, 1.0f);  // all grow
        for (float& x : s[Group::kOpacity].param) x = std::abs(x);
        backend->upload(s);
        AdcParams p;
        p.extent = 40;  // clones and splits, about as many
        const DensifyStats stats = backend->densify({p, 600, 1});
        EXPECT_GT(stats.cloned, 0);
        EXPECT_GT(stats.split, 0);
        EXPECT_EQ(backend->count(), 120);
        RenderRequest view;
        view.camera = cast<float>(camera);
        EXPECT_GE(backend->prune_lowest_scores({view}, 0.3), 36);
        const Gaussians after = backend->download(false);
        const int width = s[Group::kResidual].width;
        for (std::int64_t i = 0; i < after.count; ++i) {  // the base colour names the parent
            std::int64_t parent = 0;
            while (parent < 60 && after[Group::kBase].param[3 * i] != s[Group::kBase].param[3 * parent]) ++parent;
            ASSERT_LT(parent, 60) << i;
            for (int c = 0; c < width; ++c)
                EXPECT_EQ(after[Group::kResidual].param[i * width + c], s[Group::kResidual].param[parent * width + c])
                    << "row " << i << " column " << c;
        }
        EXPECT_EQ(after.shared.param, s.shared.param);
    }
}

}  // namespace
}  // namespace gs::test
