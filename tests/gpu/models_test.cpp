// SPDX-License-Identifier: Apache-2.0
// Every appearance model on the CUDA backend against the CPU's templates in double: colours, gradients, shared weights;
// the separate pass against the fused kernels. Bounds on images and gradients as such are in image_test.cpp and
// step_test.cpp.
#include "appearance/model_info.h"
#include "kernels/loss/loss.h"
#include "tests/gpu/gpu_test.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

#include "appearance_types.inc"

namespace gs::test {
namespace {

constexpr ColorActivation kActivations[] = {ColorActivation::kRelu, ColorActivation::kSoftplus,
                                            ColorActivation::kSigmoid, ColorActivation::kHardSigmoid};
/// True for models that compute in half precision. It rounds inputs, weights and activations of a network to 2^-11.
/// Single precision rounds the rest to 2^-24, which sums over pixels and a lobe's exponential multiply by some hundred.
template <class Model> constexpr bool kHalf = kNumSharedOf<Model> != 0;

/// Returns |a - b| / |b| in the Euclidean norm.
double relative_distance(const std::vector<float>& a, const std::vector<double>& b, double factor = 1) {
    double difference = 0, size = 0;
    for (std::size_t i = 0; i < b.size(); ++i)
        difference += (a[i] * factor - b[i]) * (a[i] * factor - b[i]), size += b[i] * b[i];
    return size > 0 ? std::sqrt(difference / size) : std::sqrt(difference);
}

template <class Model> class GpuModel : public ::testing::Test {
  protected:
    const ModelInfo& info = appearance_model(appearance_name(static_cast<const Model*>(nullptr)));
    void SetUp() override { skip_without_device(); }

    TestScene scene(int degree, ColorActivation activation, std::int64_t n = 1500) const {
        TestScene t = random_scene(n, 0, 160, 120, -1.2, 77);
        Gaussians& g = t.model;
        g.appearance = {info.name, info.max_degree_limit, activation};
        g.active_degree = degree;
        std::mt19937 rng(78);
        std::normal_distribution<float> normal;
        auto& residuals = g[Group::kResidual];
        residuals.width = info.residual_width(info.max_degree_limit);
        residuals.param.resize(std::size_t(n) * residuals.width);
        for (float& x : residuals.param) x = 0.5f * normal(rng);
        g.shared.width = info.num_shared;
        for (int k = 0; k < info.num_shared; ++k) g.shared.param.push_back(0.3f * normal(rng));
        return t;
    }

    struct Expected {
        std::vector<double> image;
        GaussianState<double> gradients;
    };
    /// Returns the image and the gradients of the loss without regularisers from the CPU's templates in double.
    static Expected expected(const TestScene& t, const StepRequest& r) {
        const auto d = cast<double>(t.model);
        Pipeline<double, Model> pipe;
        pipe.render(d, cast<double>(r.camera), {r.background.x, r.background.y, r.background.z});
        std::vector<double> dL_dimage(pipe.image.size());
        ImageLoss<double> loss;
        loss.compute(pipe.image.data(), r.target, r.background, r.loss, dL_dimage.data());
        auto gradients = pipe.gradients(d, dL_dimage);
        return {pipe.image, std::move(gradients)};
    }
    static StepRequest request(const TestScene& t, const RandomTarget& target) {
        StepRequest r = step_request(t.camera, target.image());
        r.loss.opacity_reg = r.loss.scale_reg = 0;
        r.rates.shared = 3e-3;
        return r;
    }
    static Gaussians after_step(const TestScene& t, const StepRequest& r, const EngineOptions& options) {
        const auto gpu = make_cuda_backend(t.model.appearance, options);
        gpu->upload(t.model);
        gpu->step(r);
        return gpu->download(true);
    }
};
using AllModels = ::testing::Types<GS_ALL_APPEARANCE_MODELS>;
TYPED_TEST_SUITE(GpuModel, AllModels);

TYPED_TEST(GpuModel, ShowsTheSameColors) {
    for (const auto activation : kActivations)
        for (const int degree : {this->info.max_degree_limit, std::min(1, this->info.max_degree_limit)}) {
            const TestScene t = this->scene(degree, activation);
            for (const bool separate : {false, true}) {
                const auto gpu = make_cuda_backend(t.model.appearance, {.separate_appearance = separate});
                gpu->upload(t.model);
                for (const RenderMode mode : {RenderMode::kFull, RenderMode::kBaseOnly, RenderMode::kResidualOnly}) {
                    RenderRequest r;
                    r.camera = t.camera, r.background = t.background, r.mode = mode;
                    RenderedImage image;
                    gpu->render(r, image);
                    Pipeline<double, TypeParam> pipe;
                    pipe.render(cast<double>(t.model), cast<double>(t.camera),
                                {t.background.x, t.background.y, t.background.z}, mode);
                    // A fragment at the alpha threshold counts on one side only; it may show as much as 1/255 of a
                    // colour.
                    const double limit = kHalf<TypeParam> ? 4e-3 : 2e-4;
                    std::size_t beyond = 0;
                    double worst = 0;
                    for (std::size_t i = 0; i < image.rgb.size(); ++i) {
                        const double error = std::abs(image.rgb[i] - pipe.image[i]) / (1 + std::abs(pipe.image[i]));
                        beyond += !(error <= limit);
                        worst = std::max(worst, error);
                    }
                    EXPECT_LE(beyond, image.rgb.size() / 2000) << "mode " << int(mode) << ", worst " << worst;
                }
            }
        }
}

TYPED_TEST(GpuModel, LearnsTheSame) {
    const RandomTarget target(160, 120, 3);
    for (const auto activation : kActivations) {
        const TestScene t = this->scene(this->info.max_degree_limit, activation);
        const StepRequest r = this->request(t, target);
        const auto want = this->expected(t, r);
        for (const bool separate : {false, true}) {
            const Gaussians now = this->after_step(t, r, {.separate_appearance = separate});
            std::printf("  activation %d%s:", int(activation), separate ? ", separate" : "");
            const auto check = [&](const std::vector<float>& m, const std::vector<double>& g, const char* name,
                                   double limit) {
                if (g.empty()) return;
                const double error = relative_distance(m, g, 10);  // after one step m = 0.1 g
                std::printf(" %s %.1e", name, error);
                EXPECT_LE(error, limit) << name;
            };
            // Sums over thousands of fragments, some at the threshold, in single precision: 1e-4 at the most. Through
            // halves each of a network's products is off by 2^-11, and a neuron near 0 may be on or off.
            for (int g = 0; g < kNumGroups; ++g)
                check(now.groups[g].m, want.gradients.groups[g].param, kGroupNames[g], kHalf<TypeParam> ? 2e-2 : 1e-3);
            check(now.shared.m, want.gradients.shared.param, "shared", 1e-2);
            std::printf("\n");
        }
    }
}

TYPED_TEST(GpuModel, SeparatePassEqualsFusedKernels) {
    const RandomTarget target(160, 120, 3);
    const TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kRelu);
    const StepRequest r = this->request(t, target);
    const Gaussians fused = this->after_step(t, r, {.deterministic = true}),
                    separate = this->after_step(t, r, {.deterministic = true, .separate_appearance = true});
    for (int g = 0; g < kNumGroups; ++g) {
        const std::vector<double> want(fused.groups[g].m.begin(), fused.groups[g].m.end());
        EXPECT_LE(relative_distance(separate.groups[g].m, want), 5e-5) << kGroupNames[g];
    }
    const std::vector<double> want(fused.shared.m.begin(), fused.shared.m.end());
    EXPECT_LE(relative_distance(separate.shared.m, want), 5e-5);
}

TYPED_TEST(GpuModel, FollowsTheCpuOverManySteps) {
    const RandomTarget targets[] = {{160, 120, 3, false, false, 1}, {160, 120, 4, true, false, 2}};
    const TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kRelu);
    const auto cpu = make_cpu_backend(t.model.appearance), gpu = make_cuda_backend(t.model.appearance);
    cpu->upload(t.model), gpu->upload(t.model);
    for (int k = 0; k < 40; ++k) {
        StepRequest r = this->request(t, targets[k % 2]);
        r.target.id.view = k % 2, r.iteration = k;
        for (double& rate : r.rates.groups) rate *= 0.1;
        r.rates.shared = 3e-4;
        cpu->step(r), gpu->step(r);
    }
    gpu->synchronize();
    EXPECT_NEAR(gpu->take_stats().loss, cpu->take_stats().loss, 2e-4);
    const Gaussians a = cpu->download(true), b = gpu->download(true);
    const auto compare = [&](const std::vector<float>& before, const std::vector<float>& x, const std::vector<float>& y,
                             const char* name) {
        double difference = 0, moved = 0;
        for (std::size_t i = 0; i < before.size(); ++i) {
            ASSERT_TRUE(std::isfinite(y[i])) << name;
            difference += std::pow(double(x[i]) - y[i], 2), moved += std::pow(double(x[i]) - before[i], 2);
        }
        // Where a gradient is near zero its sign, and so a whole step of Adam, is a matter of rounding.
        EXPECT_LE(std::sqrt(difference), (kHalf<TypeParam> ? 0.3 : 0.1) * std::sqrt(moved)) << name;
        if (!before.empty()) std::printf("  %s %.1e", name, std::sqrt(difference / moved));
    };
    for (int g = 0; g < kNumGroups; ++g)
        compare(t.model.groups[g].param, a.groups[g].param, b.groups[g].param, kGroupNames[g]);
    compare(t.model.shared.param, a.shared.param, b.shared.param, "shared");
    std::printf("\n");
}

/// Leaves the residuals of the first `rows` Gaussians.
void keep_first_residuals(Gaussians& g, std::int64_t rows) {
    g[Group::kResidual].param.resize(std::size_t(rows) * g[Group::kResidual].width);
}

TYPED_TEST(GpuModel, ShowsAndLearnsTheSameWithSomeResiduals) {
    const RandomTarget target(160, 120, 3);
    const auto vector = [](const std::vector<float>& x) { return std::vector<double>(x.begin(), x.end()); };
    for (const std::int64_t rows : {0, 1, 517, 1499}) {  // 517: the border lies inside of a warp
        TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kRelu);
        keep_first_residuals(t.model, rows);
        const StepRequest r = this->request(t, target);
        const auto cpu = make_cpu_backend(t.model.appearance);
        cpu->upload(t.model);
        RenderedImage expected, image;
        cpu->render({r.camera, r.background}, expected);
        cpu->step(r);
        const Gaussians want = cpu->download(true);
        for (const EngineOptions& options :
             {EngineOptions{}, {.separate_appearance = true}, {.packed_moments = true}}) {
            const bool packed = options.packed_moments;
            SCOPED_TRACE(std::to_string(rows) + " residuals" + (options.separate_appearance ? ", separate" : "") +
                         (packed ? ", packed moments" : ""));
            const auto gpu = make_cuda_backend(t.model.appearance, options);
            gpu->upload(t.model);
            gpu->render({r.camera, r.background}, image);
            EXPECT_LE(relative_distance(image.rgb, vector(expected.rgb)), kHalf<TypeParam> ? 1e-2 : 1e-4);
            gpu->step(r);
            const Gaussians now = gpu->download(true);
            for (int g = 0; g < kNumGroups; ++g) {
                ASSERT_EQ(now.groups[g].m.size(), want.groups[g].m.size()) << kGroupNames[g];
                // Of one Gaussian a single neuron that is on or off by rounding shows.
                const double half = rows == 1 ? 0.3 : 2e-2;
                const double single = packed && Group(g) == Group::kResidual ? 1.0 / 128 : 1e-3;
                EXPECT_LE(relative_distance(now.groups[g].m, vector(want.groups[g].m)),
                          kHalf<TypeParam> ? half : single)
                    << kGroupNames[g];
            }
            EXPECT_LE(relative_distance(now.shared.m, vector(want.shared.m)), rows == 1 ? 0.3 : 1e-2);
        }
    }
}

TYPED_TEST(GpuModel, ValuesResidualsLikeTheCpu) {
    const RandomTarget targets[] = {{160, 120, 3, false, false, 1}, {160, 120, 4, true, false, 2}};
    for (const std::int64_t rows : {0, 517, 1500}) {
        TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kRelu);
        keep_first_residuals(t.model, rows);
        const auto cpu = make_cpu_backend(t.model.appearance), gpu = make_cuda_backend(t.model.appearance);
        cpu->upload(t.model), gpu->upload(t.model);
        // From two places, since a residual that changes a colour alike in all views is worth nothing.
        const auto view = [&](std::size_t k) {
            StepRequest r = this->request(t, targets[k]);
            if (k == 1) {
                r.camera.translation.x += 0.4f, r.camera.translation.y -= 0.3f;
                r.camera.position = r.camera.rotation.transposed_times(r.camera.translation) * -1.0f;
            }
            return r;
        };
        const ResidualScores a = cpu->residual_scores(2, view), b = gpu->residual_scores(2, view);
        ASSERT_EQ(b.worth.size(), 1500u);
        EXPECT_LE(relative_distance(b.worth, {a.worth.begin(), a.worth.end()}), kHalf<TypeParam> ? 3e-2 : 1e-3);
        EXPECT_LE(relative_distance(b.mean_base, {a.mean_base.begin(), a.mean_base.end()}), 1e-2);
        for (std::size_t k = 0; k < 2; ++k) {
            const double error = cpu->half_squared_error(view(k));
            EXPECT_NEAR(gpu->half_squared_error(view(k)), error, (kHalf<TypeParam> ? 1e-2 : 1e-4) * error);
        }
    }
}

TYPED_TEST(GpuModel, IsRepeatableToTheBitOnRequest) {
    const RandomTarget target(160, 120, 3);
    const TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kRelu, 20000);
    Gaussians runs[2];
    for (Gaussians& g : runs) {
        const auto gpu = make_cuda_backend(t.model.appearance, {.deterministic = true});
        gpu->upload(t.model);
        for (int k = 0; k < 5; ++k) gpu->step(this->request(t, target));
        g = gpu->download(true);
    }
    expect_same_bits(runs[0], runs[1]);
    EXPECT_TRUE(same_bits(runs[0].shared.param, runs[1].shared.param));
    EXPECT_TRUE(same_bits(runs[0].shared.v, runs[1].shared.v));
}

TYPED_TEST(GpuModel, StaysFiniteAtTheExtremes) {
    const RandomTarget target(160, 120, 3);
    for (const float size : {1e-30f, 1e-6f, 30.0f, 1e4f, 1e30f}) {
        TestScene t = this->scene(this->info.max_degree_limit, ColorActivation::kSoftplus);
        std::mt19937 rng(5);
        for (float& x : t.model[Group::kResidual].param) x = rng() % 2 ? size : -size;
        for (float& x : t.model.shared.param)
            x = std::min(size, float(kLargestSharedWeight)) * (rng() % 2 ? 1.0f : -1.0f);
        const Gaussians now = this->after_step(t, this->request(t, target), {});
        for (int g = 0; g < kNumGroups; ++g) {
            expect_finite(now.groups[g].param, kGroupNames[g]);
            expect_finite(now.groups[g].m, kGroupNames[g]);
        }
        expect_finite(now.shared.param, "shared weights");
        expect_finite(now.shared.v, "moments of shared weights");
    }
}

}  // namespace
}  // namespace gs::test
