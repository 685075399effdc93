// SPDX-License-Identifier: Apache-2.0
// Runs under a limit of time or size, from the first step to the saved model.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "lib/scene/procedural.h"
#include "lib/train/trainer.h"
#include "lib/train/training_views.h"
#include "tests/core/temporary_folder.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

Scene& scene() {
    static Scene scene = [] {
        SceneOptions options;
        options.resolution = 32;
        return load_builtin_scene("diffuse", options);
    }();
    return scene;
}

TrainOptions options_for(const std::filesystem::path& folder) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = folder.string();
    o.device = Device::kCpu;
    o.appearance = "none";
    o.iterations = 60;
    o.cap_max = 2000, o.init_points = 1000;
    return o;
}

TrainSummary run(TrainOptions options, const TrainHooks& hooks = {}) {
    options = resolve(options);
    Progress progress(ProgressStyle::kSilent);
    return train(options, scene(), open_run(options), progress, hooks);
}

TEST(TimeLimit, EndsWithTheModelAndWithoutACheckpoint) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.time_limit = parse_duration("1s", "");
    const TrainSummary summary = run(o);
    EXPECT_GT(summary.iterations, 1);
    EXPECT_GT(summary.limited_seconds, 0.8);
    EXPECT_LT(summary.limited_seconds, 10) << "far above, for machines that are busy";
    EXPECT_GE(summary.limited_seconds, summary.saving_seconds);
    const RunFolder folder{o.model};
    EXPECT_EQ(latest_point_cloud(o.model), summary.iterations);
    EXPECT_EQ(ended_at(o), summary.iterations);
    EXPECT_EQ(read_ply(folder.point_cloud(summary.iterations)).count, summary.num_gaussians);
    EXPECT_FALSE(std::filesystem::exists(folder.checkpoint(summary.iterations)));
    EXPECT_TRUE(load_run_options(o.model).time_limit == o.time_limit);
}

TEST(TimeLimit, AResumedRunHasTheTimeThatWasLeft) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.time_limit = parse_duration("1s", "");
    o.checkpoint_iterations = {3};
    const TrainSummary whole = run(o);
    const auto file = RunFolder{o.model}.checkpoint(3);
    const Checkpoint checkpoint = read_checkpoint(file);
    ASSERT_TRUE(checkpoint.time);
    EXPECT_GT(checkpoint.time->limited_seconds, 0);
    EXPECT_LT(checkpoint.time->limited_seconds, whole.limited_seconds);
    o.resume = file.string();
    o.time_limit = parse_duration("0.7s", "");  // so that it ends earlier than the first part did
    const TrainSummary rest = run(o);
    EXPECT_GT(rest.iterations, 3);
    EXPECT_GT(rest.limited_seconds, 0.5) << "counts both parts";
    EXPECT_LT(rest.limited_seconds, 10);
    EXPECT_EQ(latest_point_cloud(o.model), rest.iterations) << "the end of the first part is gone";
}

TEST(TimeLimit, EvaluationsDoNotCount) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.time_limit = parse_duration("0.6s", "");
    o.test_iterations = {1};
    TrainHooks hooks;
    hooks.evaluate = [](std::int64_t, Backend&, bool last) {
        const double end = seconds_now() + (last ? 0 : 1.5);
        while (seconds_now() < end) {
        }
        return std::nullopt;
    };
    const double start = seconds_now();
    const TrainSummary summary = run(o, hooks);
    EXPECT_GT(summary.iterations, 1);
    EXPECT_LT(summary.limited_seconds, seconds_now() - start - 1.4);
}

TEST(TimeLimit, ControllersHaveAShare) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.time_limit = parse_duration("2s", ""), o.ppisp = PpispMode::kOn;
    const TrainSummary summary = run(o);
    EXPECT_GT(summary.controller_iterations, 0);
    EXPECT_GT(summary.controller_seconds, 0);
    EXPECT_TRUE(std::filesystem::exists(RunFolder{o.model}.ppisp()));
}

TEST(SizeLimit, EndsWithAtMostThatManyGaussians) {
    const test::TemporaryFolder tmp;
    for (const std::int64_t most : {20, 300, 1500}) {
        TrainOptions o = options_for(tmp.path() / std::to_string(most));
        o.iterations = 400;
        TrainHooks hooks;
        hooks.most_gaussians = most;
        const TrainSummary summary = run(o, hooks);
        EXPECT_LE(summary.num_gaussians, most);
        EXPECT_GE(double(summary.num_gaussians), 0.95 * double(most));
        EXPECT_EQ(read_ply(RunFolder{o.model}.point_cloud(400)).count, summary.num_gaussians);
    }
}

/// A device whose frames take a millisecond per 100 Gaussians, and half a millisecond besides.
class Slow : public test::ForwardingEngine {
  public:
    using ForwardingEngine::ForwardingEngine;
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int) override {
        EXPECT_EQ(views.at(0).camera.width, 1280);
        EXPECT_EQ(views.at(0).camera.cy, 360);
        return 5e-4 + 1e-5 * double(counts().count);
    }
};

TrainHooks slow_device() {
    TrainHooks hooks;
    hooks.make_backend = [](const AppearanceSpec& appearance, const EngineOptions&) {
        return std::make_unique<Backend>(std::make_unique<Slow>(appearance));
    };
    return hooks;
}

TEST(FrameLimit, EndsWithFramesThatAreFastEnough) {
    const test::TemporaryFolder tmp;
    for (const char* limit : {"4ms", "15ms"}) {  // fewer than the first points, and more
        TrainOptions o = options_for(tmp.path() / limit);
        o.iterations = 400;
        o.frame_limit = parse_duration(limit, "");
        const TrainSummary summary = run(o, slow_device());
        const double seconds = limit[0] == '4' ? 0.004 : 0.015;
        EXPECT_LE(summary.frame_seconds, seconds);
        EXPECT_GT(summary.frame_seconds, 0.8 * seconds);
        EXPECT_EQ(read_ply(RunFolder{o.model}.point_cloud(400)).count, summary.num_gaussians);
    }
}

TEST(FrameLimit, ALimitThatNoFrameMeetsIsRefused) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.frame_limit = parse_duration("0.5ms", "");
    try {
        run(o, slow_device());
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("with one Gaussian takes 0.51 ms"), std::string::npos) << e.what();
    }
}

/// Notes the sizes of the targets.
class Watched : public test::ForwardingEngine {
  public:
    using ForwardingEngine::ForwardingEngine;
    void step(const StepRequest& request) override {
        EXPECT_EQ(request.camera.width, request.target.width);
        EXPECT_EQ(request.camera.height, request.target.height);
        ids[request.target.width].insert(request.target.id);
        fx = request.camera.fx;
        widths.push_back(request.target.width);
        ForwardingEngine::step(request);
    }
    std::map<int, std::set<ImageId>> ids;
    std::vector<int> widths;
    float fx = 0;
};

TEST(CoarseImages, ComeFirstAndAreOtherImages) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.coarse_until = 0.5;
    Watched* watched = nullptr;
    TrainHooks hooks;
    hooks.make_backend = [&](const AppearanceSpec& appearance, const EngineOptions&) {
        auto engine = std::make_unique<Watched>(appearance);
        watched = engine.get();
        return std::make_unique<Backend>(std::move(engine));
    };
    std::vector<int> widths;
    std::map<int, std::set<ImageId>> ids;
    hooks.evaluate = [&](std::int64_t, Backend&, bool) {
        widths = watched->widths, ids = watched->ids;
        return std::nullopt;
    };
    run(o, hooks);
    const int full = scene().train[0].camera.width;
    ASSERT_EQ(widths.size(), 60u);
    for (std::size_t k = 0; k < widths.size(); ++k) EXPECT_EQ(widths[k], k < 30 ? full / 2 : full) << k;
    for (const ImageId id : ids[full / 2]) EXPECT_FALSE(ids[full].contains(id)) << "a device keeps images by id";
}

TEST(CoarseImages, AreAveragesOverAreas) {
    TrainOptions o = options_for("unused");
    o = resolve(o);
    TrainingViews views(o, scene());
    const auto full = views.at(0, 1), coarse = views.at(0, 1, 2);
    ASSERT_EQ(full.index, coarse.index);
    const Image &a = full.image->color, &b = coarse.image->color;
    ASSERT_EQ(b.width, a.width / 2);
    ASSERT_EQ(b.height, a.height / 2);
    if (a.is_float() || a.channels != 3) GTEST_SKIP() << "the scene has images of another kind";
    double sum_a = 0, sum_b = 0;
    for (const std::uint8_t v : a.u8) sum_a += v;
    for (const std::uint8_t v : b.u8) sum_b += v;
    EXPECT_NEAR(sum_a / double(a.u8.size()), sum_b / double(b.u8.size()), 0.6);
}

/// A quality that grows with the model: what a scene of this size can hold is not the matter here.
HeldOutPsnr quality_of(Backend& backend) { return {10 + std::log2(double(backend.count())), 0.5}; }

TrainSummary run_to_quality(const TrainOptions& options) {
    TrainHooks hooks;
    hooks.held_out_psnr = quality_of;
    return run(options, hooks);
}

TEST(TargetPsnr, EndsWithTheSmallestModelThatReachesIt) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.iterations = 100, o.target_psnr = 19;
    const TrainSummary summary = run_to_quality(o);
    ASSERT_TRUE(summary.target);
    EXPECT_TRUE(summary.target->reached) << summary.target->verdict;
    EXPECT_GE(summary.target->psnr, 19);
    EXPECT_EQ(summary.target->standard_error, 0.5);
    EXPECT_EQ(summary.num_gaussians, summary.target->count);
    EXPECT_GE(summary.num_gaussians, 512);
    EXPECT_LE(summary.num_gaussians, 560);
    EXPECT_EQ(read_ply(RunFolder{o.model}.point_cloud(summary.iterations)).count, summary.num_gaussians);
    EXPECT_EQ(ended_at(o), summary.iterations);
}

TEST(TargetPsnr, SaysWhyItWasNotReached) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.target_psnr = 50;
    const TrainSummary summary = run_to_quality(o);
    ASSERT_TRUE(summary.target);
    EXPECT_FALSE(summary.target->reached);
    EXPECT_EQ(summary.iterations, 60) << "options.iterations is the most";
    EXPECT_NE(summary.target->verdict.find("not reached"), std::string::npos);
    EXPECT_TRUE(std::filesystem::exists(RunFolder{o.model}.checkpoint(60)));
}

TEST(TargetPsnr, ATimeLimitEndsTheSearch) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.iterations = 1000000, o.target_psnr = 50, o.time_limit = parse_duration("0.5s", "");
    TrainHooks hooks;
    int measured = 0;
    hooks.held_out_psnr = [&](Backend&) { return HeldOutPsnr{20.0 + ++measured}; };  // there is always hope
    const TrainSummary summary = run(o, hooks);
    EXPECT_FALSE(summary.target->reached);
    EXPECT_NE(summary.target->verdict.find("time limit"), std::string::npos) << summary.target->verdict;
    EXPECT_LT(summary.limited_seconds, 10) << "far above, for machines that are busy";
}

TEST(TargetPsnr, AResumedRunMeasuresFirst) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    run(o);
    const std::filesystem::path file = RunFolder{o.model}.checkpoint(o.iterations);
    Checkpoint begun = read_checkpoint(file);
    begun.options_yaml = "target-psnr: 60";  // as if it had been begun with a target
    write_checkpoint(file, begun);
    o.target_psnr = 10.5, o.resume = "latest";
    TrainHooks hooks;
    std::vector<std::int64_t> counts;
    hooks.held_out_psnr = [&](Backend& backend) {
        counts.push_back(backend.count());
        return quality_of(backend);
    };
    const TrainSummary summary = run(o, hooks);
    EXPECT_EQ(counts.front(), 5000) << "the built-in scene's points, before any step";
    EXPECT_TRUE(summary.target->reached);
    EXPECT_LT(summary.num_gaussians, 1000);
}

TEST(TargetPsnr, ARunThatStoppedWhileItShrankKeepsWhatItHad) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.target_psnr = 19;
    o.checkpoint_iterations = {100};  // 60 steps of growth, then 200 for a model of half the size
    run_to_quality(o);
    EXPECT_GT(read_checkpoint(RunFolder{o.model}.checkpoint(100)).state.count, 3000) << "the one that reached it";
    o.overwrite = true, o.resume = RunFolder{o.model}.checkpoint(100).string();
    EXPECT_TRUE(run_to_quality(o).target->reached);
}

TEST(TargetPsnr, ARunThatStoppedInItsFirstTrainingEndsIt) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.target_psnr = 50;
    o.checkpoint_iterations = {20};
    run_to_quality(o);
    o.overwrite = true, o.resume = RunFolder{o.model}.checkpoint(20).string();
    const TrainSummary rest = run_to_quality(o);
    EXPECT_EQ(rest.iterations, 60);
    EXPECT_EQ(rest.target->measurements, 1) << "not before the end of the first training";
}

TEST(TimeLimit, TimeBeforeTheFirstStepCounts) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run");
    o.time_limit = parse_duration("1s", "");
    o = resolve(o);
    Progress progress(ProgressStyle::kSilent);
    RunStart start = open_run(o);
    start.used_seconds = 0.5;
    const double begin = seconds_now();
    const TrainSummary summary = train(o, scene(), std::move(start), progress, {});
    EXPECT_LT(seconds_now() - begin, 10);
    EXPECT_GT(summary.limited_seconds, 0.8);
    EXPECT_LT(summary.train_seconds, summary.limited_seconds - 0.4);
}

TEST(TargetPsnr, ContradictionsAreRefused) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.target_psnr = 30;
    TrainOptions fixed = o, adc = o;
    fixed.schedule = ScheduleKind::kFixed;
    EXPECT_THROW(resolve(fixed), UsageError);
    adc.strategy = Strategy::kAdc;
    EXPECT_THROW(resolve(adc), UsageError);
    o.target_psnr = -1;
    EXPECT_THROW(resolve(o), UsageError);
}

}  // namespace
}  // namespace gs
