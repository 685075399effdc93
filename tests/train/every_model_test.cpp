// SPDX-License-Identifier: Apache-2.0
// Every registered model trains with each colour activation. Knows no model by name, so that it runs on any registry.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <filesystem>
#include <numeric>
#include <string>

#include "appearance/model_info.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/procedural.h"
#include "lib/train/trainer.h"
#include "tests/core/temporary_folder.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

constexpr std::size_t kViews = 5;
constexpr int kEpochs = 12;

/// Returns some views of a glossy built-in scene. They are made once, because its rays take longer than a training.
Scene& glossy_scene() {
    static Scene scene = [] {
        SceneOptions options;
        options.resolution = 40;
        Scene s = load_builtin_scene("glossy", options);
        for (std::size_t k = 0; k < kViews; ++k) s.train[k] = s.train[k * s.train.size() / kViews];
        s.train.resize(kViews);
        s.points.positions.resize(400), s.points.colors.resize(400);
        return s;
    }();
    return scene;
}

/// Trains with the whole residual from the first step on (the schedule would wait for iteration 1000) and writes down
/// each loss.
class WatchedEngine : public test::ForwardingEngine {
  public:
    WatchedEngine(const AppearanceSpec& appearance, std::vector<double>& losses)
        : ForwardingEngine(appearance), degree_(appearance.max_degree), losses_(losses) {}
    void upload(const Gaussians& state) override {
        ForwardingEngine::upload(state);
        ForwardingEngine::set_active_degree(degree_);
    }
    void set_active_degree(int) override {}
    void step(const StepRequest& request) override {
        ForwardingEngine::step(request);
        stats_ = ForwardingEngine::take_stats();
        losses_.push_back(stats_.loss);
    }
    StepStats take_stats() override { return stats_; }

  private:
    int degree_;
    std::vector<double>& losses_;
    StepStats stats_;
};

/// Trains `model` with one activation in `folder` and checks how it went.
void expect_training_works(const ModelInfo& model, ColorActivation activation, const std::filesystem::path& folder) {
    SCOPED_TRACE(word(activation));
    TrainOptions o;
    o.source = "builtin:glossy";
    o.model = folder.string();
    o.appearance = model.name;
    o.color_activation = activation;
    o.iterations = kEpochs * std::int64_t(kViews);
    o.device = Device::kCpu;
    o = resolve(o);
    std::vector<double> losses;
    TrainHooks hooks;
    hooks.make_backend = [&](const AppearanceSpec& appearance, const EngineOptions&) {
        return std::make_unique<Backend>(std::make_unique<WatchedEngine>(appearance, losses));
    };
    Progress progress(ProgressStyle::kSilent);
    train(o, glossy_scene(), open_run(o), progress, hooks);
    ASSERT_EQ(losses.size(), kEpochs * kViews);
    // An epoch shows every view once, so that epochs compare.
    const double first = std::accumulate(losses.begin(), losses.begin() + kViews, 0.0),
                 last = std::accumulate(losses.end() - kViews, losses.end(), 0.0);
    EXPECT_LT(last, 0.8 * first);
    const Gaussians trained = read_checkpoint(RunFolder{o.model}.checkpoint(o.iterations)).state;
    for (int k = 0; k < kNumGroups; ++k) {
        const auto& group = trained.groups[k];
        for (const auto* values : {&group.param, &group.m, &group.v})
            for (const float x : *values) ASSERT_TRUE(std::isfinite(x)) << kGroupNames[k];
    }
    double learned = 0;
    for (const float v : trained[Group::kResidual].v) learned += v;
    EXPECT_EQ(learned > 0, model.residual_width(model.default_max_degree) > 0) << "gradients reach the residual";
}

class TrainEveryModel : public ::testing::TestWithParam<const ModelInfo*> {};
INSTANTIATE_TEST_SUITE_P(All, TrainEveryModel, ::testing::ValuesIn(appearance_models()),
                         [](const auto& info) { return info.param->name; });

TEST_P(TrainEveryModel, LossFallsAndEverythingStaysFiniteWithEachActivation) {
    spdlog::set_level(spdlog::level::err);  // the runs' messages would bury the results
    const test::TemporaryFolder folder;
    for (int activation = 0; activation < 4; ++activation)
        expect_training_works(*GetParam(), ColorActivation(activation), folder.path() / std::to_string(activation));
}

}  // namespace
}  // namespace gs
