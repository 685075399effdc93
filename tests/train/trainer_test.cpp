// SPDX-License-Identifier: Apache-2.0
// The training loop: resume equality, thread invariance, schedules, numeric failure.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/ply.h"
#include "lib/scene/procedural.h"
#include "lib/train/densification.h"
#include "lib/train/learning_rates.h"
#include "lib/train/run_costs.h"
#include "lib/train/trainer.h"
#include "lib/train/training_views.h"
#include "tests/core/temporary_folder.h"
#include "tests/kernels/forwarding_engine.h"
#include "tests/model/hostile_start.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

/// A scene of a few 32x24 views with a gradient, seen from a line of cameras.
Scene small_scene(bool alpha = false) {
    Scene scene;
    scene.source = "test";
    scene.kind = "builtin";
    for (int k = 0; k < 6; ++k) {
        View v;
        v.name = std::to_string(k) + ".png";
        v.camera.width = 32, v.camera.height = 24, v.camera.fx = v.camera.fy = 30, v.camera.cx = 16, v.camera.cy = 12;
        v.camera.translation = Eigen::Vector3d(0.2 * k - 0.5, 0.05 * k, 3);
        const int channels = alpha ? 4 : 3;
        v.load = [k, channels] {
            ViewImage image;
            image.color = Image{32, 24, channels, {}, {}};
            for (int y = 0; y < 24; ++y)
                for (int x = 0; x < 32; ++x)
                    for (int c = 0; c < channels; ++c)
                        image.color.u8.push_back(c == 3 ? 200 : std::uint8_t(7 * x + 3 * y * c + 10 * k));
            return image;
        };
        v.image_bytes = 32 * 24 * channels;
        scene.train.push_back(v);
    }
    for (int i = 0; i < 200; ++i) {
        scene.points.positions.emplace_back(0.02f * float(i % 20) * 5 - 1, 0.15f * float(i / 20) - 0.7f,
                                            0.3f * std::sin(float(i)));
        scene.points.colors.emplace_back(0.5f, 0.4f, 0.3f);
    }
    scene.extent = camera_extent(scene.train, scene.points);
    return scene;
}

TrainOptions small_options(const fs::path& folder, Strategy strategy) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = folder.string();
    o.iterations = 60;
    o.device = Device::kCpu;  // whose results are the same to the bit
    o.strategy = strategy;
    o.cap_max = 260;
    o.densify_from_iter = 10, o.densify_until_iter = 55, o.densification_interval = 10;
    o.densify_grad_threshold = 1e-6;
    o.opacity_reset_interval = 40;
    o.schedule = ScheduleKind::kFixed;  // parts of a run, which have other lengths, follow the same schedule
    o = resolve(o);
    return o;
}

TrainSummary run(const TrainOptions& options, Scene scene, const TrainHooks& hooks = {}) {
    Progress progress(ProgressStyle::kSilent);
    return train(options, scene, open_run(options), progress, hooks);
}

std::string bytes_of(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// Reads the loss in the last "step" line of the log.
double last_loss(const TrainOptions& o) {
    std::ifstream log(RunFolder{o.model}.train_log());
    double loss = -1;
    for (std::string line; std::getline(log, line);) {
        const auto json = parse_json(line);
        if (json["event"] == "step") loss = json["loss"];
    }
    return loss;
}

const bool quiet = (spdlog::set_level(spdlog::level::err), true);  // the runs' messages would bury the results

class TrainStrategies : public ::testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(All, TrainStrategies, ::testing::Values(Strategy::kMcmc, Strategy::kAdc, Strategy::kNone));

/// A run stopped at `stop` and resumed has to end like one that was not.
void expect_resuming_equals_not_stopping(TrainOptions whole, std::int64_t stop, const fs::path& folder) {
    const Scene scene = small_scene();
    run(whole, scene);
    TrainOptions part = whole;
    part.model = folder.string();
    part.iterations = stop;
    run(part, scene);
    part.iterations = whole.iterations;
    part.resume = "latest";
    EXPECT_EQ(run(part, scene).iterations, whole.iterations);
    const std::int64_t end = whole.iterations;
    EXPECT_EQ(bytes_of(RunFolder{whole.model}.point_cloud(end)), bytes_of(RunFolder{part.model}.point_cloud(end)));
    const Checkpoint a = read_checkpoint(RunFolder{whole.model}.checkpoint(end)),
                     b = read_checkpoint(RunFolder{part.model}.checkpoint(end));
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_EQ(a.state.groups[g].param, b.state.groups[g].param) << kGroupNames[g];
        EXPECT_EQ(a.state.groups[g].m, b.state.groups[g].m) << kGroupNames[g];
        EXPECT_EQ(a.state.groups[g].v, b.state.groups[g].v) << kGroupNames[g];
    }
    EXPECT_EQ(a.state.active_degree, b.state.active_degree);
    EXPECT_EQ(a.state.step, end);
}

// 37 is between two densifications, so the ADC statistic has to survive too.
TEST_P(TrainStrategies, ResumingEqualsNotStoppingBitForBit) {
    const test::TemporaryFolder tmp;
    expect_resuming_equals_not_stopping(small_options(tmp.path() / "whole", GetParam()), 37, tmp.path() / "part");
}

// The filter of iteration 100 has to survive until 137.
TEST(TrainAntialiased, ResumingEqualsNotStoppingAndFilesSayIt) {
    const test::TemporaryFolder tmp;
    const Scene scene = small_scene();
    TrainOptions o = small_options(tmp.path() / "whole", Strategy::kMcmc);
    o.antialiasing = Antialiasing::kOn, o.iterations = 150, o.densify_until_iter = 120;
    expect_resuming_equals_not_stopping(o, 137, tmp.path() / "part");
    const Gaussians raw = read_checkpoint(RunFolder{o.model}.checkpoint(150)).state;
    const Gaussians shown = read_ply(RunFolder{o.model}.point_cloud(150));
    EXPECT_TRUE(raw.antialiased && shown.antialiased);
    EXPECT_GT(std::ranges::count_if(raw[Group::kSmoothing].param, [](float f) { return f > 0; }), raw.count / 2);
    EXPECT_EQ(shown[Group::kSmoothing].width, 0);
    EXPECT_GT(std::ranges::min(shown[Group::kScale].param), std::ranges::min(raw[Group::kScale].param));

    // Trainings that begin with the model stay antialiased, and look like it.
    TrainOptions next = small_options(tmp.path() / "next", Strategy::kNone);
    next.init = o.model, next.iterations = 1, next.position_lr_init = next.scaling_lr = next.rotation_lr = 1e-9;
    next.opacity_lr = 1e-9;
    run(next, scene);
    const Gaussians again = read_ply(RunFolder{next.model}.point_cloud(1));
    EXPECT_TRUE(again.antialiased);
    ASSERT_EQ(again.count, shown.count);
    for (std::size_t i = 0; i < shown[Group::kScale].param.size(); ++i)
        EXPECT_NEAR(again[Group::kScale].param[i], shown[Group::kScale].param[i], 1e-4);
    next.antialiasing = Antialiasing::kOff, next.overwrite = true;
    run(next, scene);
    EXPECT_FALSE(read_ply(RunFolder{next.model}.point_cloud(1)).antialiased);
    EXPECT_FALSE(read_checkpoint(RunFolder{next.model}.checkpoint(1)).state.antialiased);
}

/// Returns the values of `name` in the log lines of this event.
std::vector<std::int64_t> logged(const TrainOptions& o, const std::string& event, const std::string& name) {
    std::ifstream log(RunFolder{o.model}.train_log());
    std::vector<std::int64_t> values;
    for (std::string line; std::getline(log, line);) {
        const auto json = parse_json(line);
        if (json["event"] == event) values.push_back(json[name]);
    }
    return values;
}

// The pruning at 6000 is soft, before the step, where densification lasts, and else hard, after it. The runs start from
// a checkpoint that says it had 5990 iterations.
TEST(TrainSpeedySplat, ResumingAroundAPruningEqualsNotStopping) {
    const test::TemporaryFolder tmp;
    Scene scene = small_scene();
    scene.extent = 10;  // or all would be too large for it
    TrainOptions first = small_options(tmp.path() / "first", Strategy::kAdc);
    run(first, scene);
    Checkpoint start = read_checkpoint(RunFolder{first.model}.checkpoint(60));
    start.iteration = 5990;
    for (const bool hard : {false, true}) {
        TrainOptions whole = small_options(tmp.path() / (hard ? "hard" : "soft"), Strategy::kAdc);
        whole.speedy_splat = true, whole.iterations = 6010, whole.densify_until_iter = hard ? 5995 : 6100;
        whole.resume = (tmp.path() / "start.safetensors").string();
        write_checkpoint(whole.resume, start);
        run(whole, scene);
        EXPECT_EQ(logged(whole, "prune_by_score", "iteration"), (std::vector<std::int64_t>{6001}));
        const std::int64_t pruned = logged(whole, "prune_by_score", "pruned").at(0),
                           left = logged(whole, "prune_by_score", "num_gaussians").at(0);
        EXPECT_NEAR(double(pruned) / double(pruned + left), hard ? 0.3 : 0.8, 0.1);
        for (const std::int64_t stop : {6000, 6001}) {
            TrainOptions part = whole;
            part.model = (tmp.path() / (std::to_string(stop) + (hard ? "h" : "s"))).string();
            part.iterations = stop;
            run(part, scene);
            part.iterations = whole.iterations, part.resume = "latest";
            run(part, scene);
            EXPECT_EQ(bytes_of(RunFolder{whole.model}.point_cloud(6010)),
                      bytes_of(RunFolder{part.model}.point_cloud(6010)))
                << stop;
            EXPECT_EQ(logged(part, "prune_by_score", "pruned"), std::vector<std::int64_t>{pruned}) << stop;
        }
    }
}

class TrainModels : public ::testing::TestWithParam<const ModelInfo*> {};
INSTANTIATE_TEST_SUITE_P(All, TrainModels, ::testing::ValuesIn(appearance_models()),
                         [](const auto& info) { return info.param->name; });

// Degree 1 begins at 1000.
TEST_P(TrainModels, ResumingWithAnActiveResidualEqualsNotStopping) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "whole", Strategy::kMcmc);
    o.appearance = GetParam()->name;
    o.iterations = 1012;
    expect_resuming_equals_not_stopping(o, 1006, tmp.path() / "part");
    const Checkpoint c = read_checkpoint(RunFolder{o.model}.checkpoint(1012));
    EXPECT_EQ(c.state.active_degree, std::min(GetParam()->max_degree_limit, GetParam()->initial_degree + 1));
    const auto& residuals = c.state[Group::kResidual];
    std::vector<float> initial(std::size_t(residuals.width), 0);
    GetParam()->init_residual(c.state.appearance.max_degree, initial.data());
    std::size_t moved = 0;
    for (std::size_t k = 0; k < residuals.param.size(); ++k) moved += residuals.param[k] != initial[k % initial.size()];
    EXPECT_TRUE(residuals.width == 0 || moved > 0) << "the residual learns";
}

/// Options of a run in which 30 % keep a residual, by the schedule of a whole run of 60 iterations: the choice falls
/// before iteration 51.
TrainOptions mixed_options(const fs::path& folder) {
    TrainOptions o = small_options(folder, Strategy::kMcmc);
    o.schedule = ScheduleKind::kProgress;
    o.appearance_share = 0.3;
    return o;
}

TEST(TrainMixed, ResumingAroundTheChoiceEqualsNotStopping) {
    const Scene scene = small_scene();
    const test::TemporaryFolder folder;
    TrainOptions whole = mixed_options(folder.path() / "whole");
    whole.checkpoint_iterations = {30, 50, 55};
    const TrainSummary summary = run(whole, scene);
    EXPECT_NEAR(summary.residual_share, 0.3, 0.01);
    const RunFolder folder_of_whole{whole.model};
    for (const std::int64_t stop : whole.checkpoint_iterations) {
        TrainOptions rest = mixed_options(folder.path() / std::to_string(stop));
        rest.resume = folder_of_whole.checkpoint(stop).string();
        run(rest, scene);
        EXPECT_EQ(bytes_of(RunFolder{rest.model}.point_cloud(60)), bytes_of(folder_of_whole.point_cloud(60))) << stop;
    }
    const Gaussians back = read_ply(folder_of_whole.point_cloud(60));
    EXPECT_TRUE(back.is_mixed());
    EXPECT_EQ(back.num_residuals(), std::llround(summary.residual_share * double(back.count)));
}

TEST(TrainMixed, AShareOfAllChangesNothing) {
    const Scene scene = small_scene();
    const test::TemporaryFolder folder;
    TrainOptions one = mixed_options(folder.path() / "one"), all = mixed_options(folder.path() / "all");
    one.appearance_share = 1, all.appearance_share = TrainOptions{}.appearance_share;
    run(one, scene), run(all, scene);
    EXPECT_EQ(bytes_of(RunFolder{one.model}.point_cloud(60)), bytes_of(RunFolder{all.model}.point_cloud(60)));
}

TEST_P(TrainModels, TrainWithSomeResiduals) {
    const test::TemporaryFolder folder;
    TrainOptions o = mixed_options(folder.path() / "m");
    o.appearance = GetParam()->name;
    const TrainSummary summary = run(o, small_scene());
    const Gaussians model = read_ply(RunFolder{o.model}.point_cloud(60));
    if (model[Group::kResidual].width > 0) {
        EXPECT_NEAR(summary.residual_share, 0.3, 0.01);
        EXPECT_EQ(model.num_residuals(), std::llround(summary.residual_share * double(model.count)));
    }
}

TEST_P(TrainStrategies, DoesNotDependOnTheNumberOfThreads) {
    const test::TemporaryFolder tmp;
    const Scene scene = small_scene(true);
    std::string first;
    for (int threads : {1, 3}) {
        TrainOptions o = small_options(tmp.path() / std::to_string(threads), GetParam());
        o.threads = threads;
        run(o, scene);
        const std::string bytes = bytes_of(RunFolder{o.model}.point_cloud(60));
        if (first.empty()) first = bytes;
        EXPECT_EQ(first, bytes);
    }
    set_num_threads(0);
}

TEST_P(TrainStrategies, LowersTheLossAndKeepsTheBudget) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "begin", GetParam());
    o.iterations = 1;
    run(o, small_scene());
    const double first = last_loss(o);
    o.model = (tmp.path() / "run").string();
    o.iterations = 300;
    o.opacity_reset_interval = 1000;
    const TrainSummary summary = run(o, small_scene());
    EXPECT_LT(last_loss(o), 0.7 * first);
    EXPECT_LE(summary.num_gaussians, o.cap_max);
    EXPECT_GT(summary.num_gaussians, 0);
    std::ifstream log(RunFolder{o.model}.train_log());
    std::int64_t densifications = 0;
    for (std::string line; std::getline(log, line);) {
        const auto json = parse_json(line);
        if (json["event"] == "densify") ++densifications;
    }
    EXPECT_EQ(densifications > 0, o.strategy != Strategy::kNone);
}

/// Makes a share of the Gaussians that a training begins with extreme.
class HostileEngine : public test::ForwardingEngine {
  public:
    HostileEngine(const AppearanceSpec& appearance, double share) : ForwardingEngine(appearance), share_(share) {}
    void upload(const Gaussians& state) override {
        Gaussians first = state;
        test::make_hostile(first, std::exchange(share_, 0), 0);
        ForwardingEngine::upload(first);
    }

  private:
    double share_;
};

/// Runs 600 iterations and returns the mean loss of the last 100. Expects a falling loss and finite results.
double hostile_run(const fs::path& folder, const std::string& model, double share) {
    TrainOptions o = small_options(folder, Strategy::kMcmc);
    o.appearance = model;
    o.iterations = 600;
    o.densify_until_iter = 500;
    TrainHooks hooks;
    hooks.make_backend = [=](const AppearanceSpec& appearance, const EngineOptions&) {
        return std::make_unique<Backend>(std::make_unique<HostileEngine>(appearance, share));
    };
    run(o, small_scene(), hooks);
    const Checkpoint end = read_checkpoint(RunFolder{o.model}.checkpoint(o.iterations));
    for (const auto& group : end.state.groups)
        EXPECT_TRUE(std::all_of(group.param.begin(), group.param.end(), [](float x) { return std::isfinite(x); }));
    EXPECT_TRUE(std::all_of(end.state.shared.param.begin(), end.state.shared.param.end(),
                            [](float x) { return std::isfinite(x); }));
    std::ifstream log(RunFolder{o.model}.train_log());
    std::vector<double> losses;
    for (std::string line; std::getline(log, line);) {
        const auto json = parse_json(line);
        if (json["event"] == "step") losses.push_back(json["loss"]);
    }
    EXPECT_LT(losses.back(), losses.front());
    return losses.back();
}

// The disturbed Gaussians are removed, relocated or trained back; what remains of them is a delay.
TEST_P(TrainModels, RecoversFromAHostileStart) {
    const test::TemporaryFolder tmp;
    const double undisturbed = hostile_run(tmp.path() / "normal", GetParam()->name, 0);
    const double recovered = hostile_run(tmp.path() / "hostile", GetParam()->name, 0.1);
    EXPECT_LT(recovered, 1.5 * undisturbed) << "undisturbed: " << undisturbed;
}

TEST(Train, SeedsDiffer) {
    const test::TemporaryFolder tmp;
    TrainOptions a = small_options(tmp.path() / "a", Strategy::kMcmc),
                 b = small_options(tmp.path() / "b", Strategy::kMcmc);
    b.seed = 1;
    run(a, small_scene());
    run(b, small_scene());
    EXPECT_NE(bytes_of(RunFolder{a.model}.point_cloud(60)), bytes_of(RunFolder{b.model}.point_cloud(60)));
}

TEST(Train, LaterResultsAreNotOverwritten) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    o.checkpoint_iterations = {30};
    run(o, small_scene());
    EXPECT_THROW(open_run(o), UsageError) << "a new run into the folder of an old one";
    o.resume = RunFolder{o.model}.checkpoint(30).string();
    EXPECT_THROW(open_run(o), UsageError) << "going back to 30 would lose 60";
    o.overwrite = true;
    EXPECT_NO_THROW(open_run(o));
    EXPECT_FALSE(fs::exists(RunFolder{o.model}.point_cloud(60)));
    TrainOptions other = small_options(tmp.path() / "run", Strategy::kNone);
    other.resume = RunFolder{o.model}.checkpoint(30).string();
    other.appearance = "none";
    other.overwrite = true;
    EXPECT_THROW(open_run(other), UsageError) << "a checkpoint of another model";
    EXPECT_TRUE(fs::exists(RunFolder{o.model}.checkpoint(30)));
}

TEST(Train, PlyAndCheckpointHoldTheSameModel) {
    const test::TemporaryFolder tmp;
    const TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    run(o, small_scene());
    const Gaussians ply = read_ply(RunFolder{o.model}.point_cloud(60));
    EXPECT_LE(ply.count, 200);
    EXPECT_GT(ply.count, 100);
}

TEST(Train, NonFiniteImagesEndTheRunWithTheReason) {
    const test::TemporaryFolder tmp;
    Scene scene = small_scene();
    for (View& v : scene.train)
        v.load = [] {
            ViewImage image;
            image.color = Image{32, 24, 3, {}, std::vector<float>(32 * 24 * 3, std::nanf(""))};
            return image;
        };
    try {
        run(small_options(tmp.path() / "run", Strategy::kMcmc), scene);
        FAIL() << "trained on NaN";
    } catch (const NumericError& e) {
        EXPECT_NE(std::string(e.what()).find("not finite"), std::string::npos) << e.what();
    }
}

/// Fails at one step, as a device does whose memory is full. Afterwards the model can be read or not, as the test asks.
class FailingEngine : public test::ForwardingEngine {
  public:
    FailingEngine(const AppearanceSpec& appearance, std::int64_t failing_iteration, bool readable)
        : ForwardingEngine(appearance), failing_iteration_(failing_iteration), readable_(readable) {}
    void step(const StepRequest& request) override {
        failed_ = request.iteration == failing_iteration_;
        if (failed_) throw DeviceError("out of device memory: asked for 8 MiB, free 3 MiB");
        ForwardingEngine::step(request);
    }
    Gaussians download(Download what) override {
        if (failed_ && !readable_) throw DeviceError("the device is gone");
        return ForwardingEngine::download(what);
    }

  private:
    const std::int64_t failing_iteration_;
    const bool readable_;
    bool failed_ = false;
};

/// Trains with a backend that fails at that iteration and returns the message of the run's DeviceError.
std::string failure(const TrainOptions& options, std::int64_t failing_iteration, bool readable) {
    TrainHooks hooks;
    hooks.make_backend = [=](const AppearanceSpec& appearance, const EngineOptions&) {
        return std::make_unique<Backend>(std::make_unique<FailingEngine>(appearance, failing_iteration, readable));
    };
    try {
        run(options, small_scene(), hooks);
    } catch (const DeviceError& e) {
        EXPECT_EQ(e.code(), ExitCode::kDevice);
        return e.what();
    }
    return "";
}

TEST(Train, OutOfMemoryLeavesACheckpointThatResumesBitForBit) {
    const test::TemporaryFolder tmp;
    const TrainOptions whole = small_options(tmp.path() / "whole", Strategy::kMcmc);
    run(whole, small_scene());
    TrainOptions part = small_options(tmp.path() / "part", Strategy::kMcmc);
    const std::string checkpoint = RunFolder{part.model}.checkpoint(33).string();
    EXPECT_EQ(failure(part, 33, true), "out of device memory: asked for 8 MiB, free 3 MiB, checkpoint written to " +
                                           checkpoint + "; continue with --resume latest -m " + part.model);
    part.resume = "latest";
    run(part, small_scene());
    EXPECT_EQ(bytes_of(RunFolder{whole.model}.point_cloud(60)), bytes_of(RunFolder{part.model}.point_cloud(60)));
}

TEST(Train, OutOfMemoryWithoutAModelToSaveKeepsItsMessage) {
    const test::TemporaryFolder tmp;
    const std::string message = "out of device memory: asked for 8 MiB, free 3 MiB";
    const TrainOptions first = small_options(tmp.path() / "first", Strategy::kNone),
                       lost = small_options(tmp.path() / "lost", Strategy::kNone);
    EXPECT_EQ(failure(first, 0, true), message) << "nothing was trained yet";
    EXPECT_EQ(failure(lost, 33, false), message);
    EXPECT_FALSE(fs::exists(tmp.path() / "lost/checkpoints"));
}

/// Returns the message of the error with which the run ends.
template <class E> std::string error_of(const TrainOptions& options, const Scene& scene) {
    try {
        run(options, scene);
    } catch (const E& e) {
        return e.what();
    }
    ADD_FAILURE() << "no such error";
    return "";
}

// With 6 views and no cache, the view of iteration 34 is decoded anew. Iteration 30 densifies.
TEST(Train, AnImageThatVanishesLeavesACheckpointThatResumesBitForBit) {
    const test::TemporaryFolder tmp;
    for (const std::int64_t lost : {34, 30}) {
        TrainOptions whole = small_options(tmp.path() / ("whole" + std::to_string(lost)), Strategy::kAdc),
                     part = small_options(tmp.path() / ("part" + std::to_string(lost)), Strategy::kAdc);
        whole.image_cache = part.image_cache = parse_bytes("0", "");
        run(whole, small_scene());
        Scene failing = small_scene();
        ViewOrder order(failing.train.size(), part.seed);
        View& view = failing.train[order.at(lost)];
        view.load = [load = view.load, &tmp, lost, asked = std::make_shared<std::atomic<int>>(0)] {
            if (++*asked > lost / 6) throw DataError("image 3.png: no such file");
            return load();
        };
        const std::string checkpoint = RunFolder{part.model}.checkpoint(lost).string();
        EXPECT_EQ(error_of<DataError>(part, failing), "image 3.png: no such file, checkpoint written to " + checkpoint +
                                                          "; continue with --resume latest -m " + part.model);
        part.resume = "latest";
        run(part, small_scene());
        EXPECT_EQ(bytes_of(RunFolder{whole.model}.point_cloud(60)), bytes_of(RunFolder{part.model}.point_cloud(60)));
    }
}

// Later images are never asked for again.
TEST(Train, ImagesThatVanishAfterTheFirstEpochAreNotMissed) {
    const test::TemporaryFolder tmp;
    Scene scene = small_scene();
    for (View& view : scene.train)
        view.load = [load = view.load, asked = std::make_shared<std::atomic<int>>(0)] {
            if (++*asked > 1) throw DataError("no such file");
            return load();
        };
    EXPECT_EQ(run(small_options(tmp.path() / "run", Strategy::kNone), scene).iterations, 60);
}

TEST(Train, TrainingTimeAddsUpOverResumes) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    o.iterations = 30;
    run(o, small_scene());
    const fs::path file = RunFolder{o.model}.checkpoint(30);
    Checkpoint checkpoint = read_checkpoint(file);
    ASSERT_TRUE(checkpoint.time);
    EXPECT_GT(checkpoint.time->train_seconds, 0);
    checkpoint.time = {1000, 400};
    write_checkpoint(file, checkpoint);
    o.iterations = 60, o.resume = "latest";
    const TrainSummary summary = run(o, small_scene());
    EXPECT_TRUE(summary.whole_time);
    EXPECT_GT(summary.train_seconds, 1000);
    EXPECT_LT(summary.train_seconds, 1100);
    EXPECT_GE(summary.data_wait_seconds, 400);
    EXPECT_LT(summary.data_wait_seconds, 500);
    EXPECT_EQ(read_checkpoint(RunFolder{o.model}.checkpoint(60)).time->train_seconds, summary.train_seconds);
    std::ifstream log(RunFolder{o.model}.train_log());
    std::string line, last;
    while (std::getline(log, line)) last = line;
    EXPECT_GT(parse_json(last)["train_seconds"], 1000);
}

TEST(Train, TimesOfOldCheckpointsStayUnknown) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    o.iterations = 30;
    run(o, small_scene());
    Checkpoint checkpoint = read_checkpoint(RunFolder{o.model}.checkpoint(30));
    checkpoint.time.reset();
    write_checkpoint(RunFolder{o.model}.checkpoint(30), checkpoint);
    o.iterations = 60, o.resume = "latest";
    EXPECT_FALSE(run(o, small_scene()).whole_time);
    EXPECT_FALSE(read_checkpoint(RunFolder{o.model}.checkpoint(60)).time) << "or the next part would believe it";
}

/// Returns the names in the checkpoints folder, sorted.
std::vector<std::string> checkpoints_of(const TrainOptions& o) {
    std::vector<std::string> names;
    std::error_code missing;
    for (const auto& entry : fs::directory_iterator(fs::path(o.model) / "checkpoints", missing))
        names.push_back(entry.path().stem());
    std::sort(names.begin(), names.end());
    return names;
}

TEST(Train, AutomaticCheckpointsReplaceEachOtherAndChangeNothing) {
    const test::TemporaryFolder tmp;
    TrainOptions without = small_options(tmp.path() / "without", Strategy::kMcmc),
                 with = small_options(tmp.path() / "with", Strategy::kMcmc);
    with.iterations = without.iterations = 350;
    without.checkpoint_minutes = 0;
    with.checkpoint_minutes = 1e-9;
    with.checkpoint_iterations = {120};
    std::vector<std::vector<std::string>> seen;
    TrainHooks hooks;
    hooks.evaluate = [&](std::int64_t, Backend&, bool) {
        seen.push_back(checkpoints_of(with));
        return std::nullopt;
    };
    with.test_iterations = {100, 110, 130, 210, 310};
    run(with, small_scene(), hooks);
    using Names = std::vector<std::string>;
    EXPECT_EQ(seen, (std::vector<Names>{{},
                                        {"iteration_100"},
                                        {"iteration_120"},
                                        {"iteration_120", "iteration_200"},
                                        {"iteration_120", "iteration_300"},
                                        {"iteration_120", "iteration_350"}}));
    run(without, small_scene());
    EXPECT_EQ(checkpoints_of(without), Names{"iteration_350"});
    EXPECT_EQ(bytes_of(RunFolder{with.model}.point_cloud(350)), bytes_of(RunFolder{without.model}.point_cloud(350)));
}

TEST(Train, AnAutomaticCheckpointThatCannotBeWrittenDoesNotEndTheRun) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    o.iterations = 250;
    o.checkpoint_minutes = 1e-9;
    const fs::path in_the_way = RunFolder{o.model}.checkpoint(100);  // a folder cannot be replaced by a file
    o.test_iterations = {50};
    TrainHooks hooks;
    hooks.evaluate = [&](std::int64_t iteration, Backend&, bool) {
        if (iteration == 50) fs::create_directories(in_the_way / "x");
        return std::nullopt;
    };
    EXPECT_EQ(run(o, small_scene(), hooks).iterations, 250);
    EXPECT_TRUE(fs::is_directory(in_the_way));
}

TEST(Train, AKilledRunThatSavedAfterItsLastCheckpointResumes) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kMcmc);
    o.save_iterations = {40}, o.checkpoint_iterations = {20};
    run(o, small_scene());
    const RunFolder folder{o.model};
    const std::string cloud = bytes_of(folder.point_cloud(40)), last = bytes_of(folder.point_cloud(60));
    fs::remove(folder.checkpoint(60));
    fs::remove_all(folder.point_cloud(60).parent_path());
    std::ofstream(folder.point_cloud(40)) << "cut short";
    o.resume = "latest";
    run(o, small_scene());
    EXPECT_EQ(bytes_of(folder.point_cloud(40)), cloud);
    EXPECT_EQ(bytes_of(folder.point_cloud(60)), last);
}

TEST(Train, TheCheckpointOfAnIterationIsItsLastFile) {
    const test::TemporaryFolder tmp;
    TrainOptions o = small_options(tmp.path() / "run", Strategy::kNone);
    o.test_iterations = o.save_iterations = o.checkpoint_iterations = {20};
    bool early = false;
    TrainHooks hooks;
    hooks.evaluate = [&](std::int64_t iteration, Backend&, bool) {
        early |= iteration == 20 && fs::exists(RunFolder{o.model}.checkpoint(20));
        EXPECT_TRUE(fs::exists(RunFolder{o.model}.point_cloud(iteration)));
        return std::nullopt;
    };
    run(o, small_scene(), hooks);
    EXPECT_FALSE(early) << "a run killed then would never write what is still missing";
    EXPECT_TRUE(fs::exists(RunFolder{o.model}.checkpoint(20)));
}

TEST(Train, AFolderThatIsRemovedOrReplacedEndsTheRun) {
    for (const bool replaced : {false, true}) {
        const test::TemporaryFolder tmp;
        TrainOptions o = small_options(tmp.path() / "run", Strategy::kMcmc);
        o.test_iterations = {25};
        TrainHooks hooks;
        hooks.evaluate = [&](std::int64_t, Backend&, bool) {
            fs::remove_all(o.model);
            if (replaced) fs::create_directory(o.model);
            return std::nullopt;
        };
        try {
            run(o, small_scene(), hooks);
            ADD_FAILURE() << "trained into nothing";
        } catch (const DataError& e) {
            EXPECT_NE(std::string(e.what()).find("'" + o.model + "' was removed or replaced"), std::string::npos)
                << e.what();
        }
        EXPECT_EQ(fs::exists(o.model), replaced);
        EXPECT_TRUE(!replaced || fs::is_empty(o.model));
    }
}

/// Gives statistics that lag two steps behind until somebody waits, and keeps one image per id.
class LaggingEngine : public test::ForwardingEngine {
  public:
    using ForwardingEngine::ForwardingEngine;
    void step(const StepRequest& request) override {
        const TargetImage& t = request.target;
        const std::vector<std::uint8_t> pixels(t.u8, t.u8 + std::size_t(t.width) * t.height * t.channels);
        EXPECT_EQ(kept_.try_emplace(t.id, pixels).first->second, pixels)
            << "view " << t.id.view << " at 1/" << t.id.factor << " stands for two images";
        ForwardingEngine::step(request);
        all_.push_back(ForwardingEngine::take_stats());
    }
    StepStats take_stats() override {
        StepStats sum = told_ ? all_[told_ - 1] : StepStats{};
        sum.steps = 0;
        for (const std::size_t end = waited_ ? all_.size() : all_.size() - std::min<std::size_t>(2, all_.size());
             told_ < end; ++told_) {
            const auto steps = sum.steps;
            sum = all_[told_];
            sum.steps += steps;
        }
        waited_ = false;
        return sum;
    }
    void synchronize() override { waited_ = true; }
    MemoryUse memory() override { return {{{"model", 600, "Gaussian", 3}}, 600, 700}; }
    std::size_t num_images() const { return kept_.size(); }

  private:
    std::vector<StepStats> all_;
    std::size_t told_ = 0;
    bool waited_ = false;
    std::map<ImageId, std::vector<std::uint8_t>> kept_;
};

TEST(Train, StatisticsThatComeLateAreWaitedForWhereTheyAreShown) {
    const test::TemporaryFolder tmp;
    const TrainOptions direct = small_options(tmp.path() / "direct", Strategy::kAdc);
    TrainOptions late = small_options(tmp.path() / "late", Strategy::kAdc);
    run(direct, small_scene());
    LaggingEngine* backend = nullptr;
    std::size_t num_images = 0;
    TrainHooks hooks;
    hooks.make_backend = [&](const AppearanceSpec& appearance, const EngineOptions& options) {
        EXPECT_EQ(options.image_budget, std::int64_t(1) << 20);
        EXPECT_TRUE(options.deterministic);
        auto engine = std::make_unique<LaggingEngine>(appearance);
        backend = engine.get();
        return std::make_unique<Backend>(std::move(engine));
    };
    hooks.evaluate = [&](std::int64_t, Backend&, bool) {
        num_images = backend->num_images();
        return std::nullopt;
    };
    late.image_cache = parse_bytes("1MiB", "");
    late.deterministic = true;
    const TrainSummary summary = run(late, small_scene(), hooks);
    EXPECT_EQ(last_loss(late), last_loss(direct)) << "the loss of the last step, not of one before";
    EXPECT_EQ(summary.memory.peak, 700);
    EXPECT_EQ(num_images, small_scene().train.size());
    EXPECT_EQ(memory_report(summary.memory),
              "device memory: peak 0.0 MiB, now 0.0 MiB: model 0.0 MiB (200 B a Gaussian)");
}

TEST(ViewOrder, VisitsEveryViewOnceAnEpochInAnyOrderOfAsking) {
    ViewOrder order(13, 5), other(13, 5);
    std::vector<std::size_t> all;
    for (int epoch = 0; epoch < 3; ++epoch) {
        std::set<std::size_t> seen;
        for (int k = 0; k < 13; ++k) seen.insert(all.emplace_back(order.at(13 * epoch + k)));
        EXPECT_EQ(seen.size(), 13u);
    }
    EXPECT_NE(std::vector(all.begin(), all.begin() + 13), std::vector(all.begin() + 13, all.begin() + 26));
    for (int k = 38; k >= 0; --k) EXPECT_EQ(other.at(k), all[k]);
}

TEST(LearningRates, FollowTheTable) {
    Scene scene = small_scene();
    scene.extent = 2;
    TrainOptions o;
    o.source = "x";
    o = resolve(o);
    const LearningRates rates(o, appearance_spec(o), scene);
    StepRates r = rates.at(moment_at(o, 0));
    EXPECT_NEAR(r.groups[0], 2 * 1.6e-4, 1e-7);
    EXPECT_NEAR(r.noise, 5e5 * r.groups[0], 1e-2);
    EXPECT_DOUBLE_EQ(r.groups[1], 0.005);
    EXPECT_DOUBLE_EQ(r.groups[2], 0.001);
    EXPECT_DOUBLE_EQ(r.groups[3], 0.05);
    EXPECT_NEAR(r.groups[4], 0.000705237, 1e-9);
    EXPECT_DOUBLE_EQ(r.groups[5], 0.000125);
    r = rates.at(moment_at(o, 29999));
    EXPECT_NEAR(r.groups[0], 2 * 1.6e-6, 1e-12);
    TrainOptions adc;
    adc.source = "x";
    adc.strategy = Strategy::kAdc;
    adc = resolve(adc);
    EXPECT_EQ(adc.opacity_lr, 0.025);
    r = LearningRates(adc, appearance_spec(adc), scene).at(moment_at(adc, 0));
    EXPECT_EQ(r.noise, 0);
}

TEST(LearningRates, AutomaticOpacityRateGrowsWithTheCameraSpacing) {
    const std::optional<double> automatic;
    EXPECT_DOUBLE_EQ(opacity_rate(0.3, 5), 0.3);
    EXPECT_DOUBLE_EQ(opacity_rate(automatic, 1e-6), 0.025);
    EXPECT_DOUBLE_EQ(opacity_rate(automatic, 0.3536), 0.025);
    EXPECT_NEAR(opacity_rate(automatic, 0.7), 0.025 * std::pow(0.7 / 0.3536, 0.6), 1e-12);
    EXPECT_DOUBLE_EQ(opacity_rate(automatic, 1e9), 0.05);
    Scene scene = small_scene();
    for (View& v : scene.train) v.camera.translation *= 2;  // neighbours 0.41 apart
    TrainOptions o;
    o.source = "x";
    o.opacity_lr = automatic, o.named = {"opacity-lr"};
    o = resolve(o);
    StepRates r = LearningRates(o, appearance_spec(o), scene).at(moment_at(o, 0));
    EXPECT_DOUBLE_EQ(r.groups[3], opacity_rate(automatic, camera_spacing(scene.train)));
    EXPECT_GT(r.groups[3], 0.025);
    EXPECT_LT(r.groups[3], 0.05);
}

/// Returns the degrees of the steps at the given iterations. All steps before them are taken, too, and the degree is
/// held at the iterations of `held`.
std::vector<int> degrees(const std::string& appearance, std::vector<std::int64_t> iterations,
                         const std::set<std::int64_t>& held = {}) {
    TrainOptions o;
    o.source = "x", o.appearance = appearance, o.strategy = Strategy::kNone;
    o = resolve(o);
    DensificationSchedule schedule(o, appearance_spec(o), 1, true, {});
    const auto backend = make_cpu_backend(appearance_spec(o));
    std::vector<int> out;
    for (std::int64_t k = 0; k <= iterations.back(); ++k) {
        schedule.before_step(*backend, moment_at(o, k), held.contains(k));
        if (std::find(iterations.begin(), iterations.end(), k) == iterations.end()) continue;
        out.push_back(schedule.active_degree());
        EXPECT_EQ(backend->download(false).active_degree, out.back());
    }
    return out;
}

TEST(DegreeSchedule, RaisesByOneEveryThousandIterations) {
    EXPECT_EQ(degrees("sh", {0, 999, 1000, 2999, 12000}), (std::vector<int>{0, 0, 1, 2, 3}));
    EXPECT_EQ(degrees("sv", {0, 1000, 2000}), (std::vector<int>{7, 7, 7}));
}

TEST(DegreeSchedule, WaitsWhileItIsHeld) {
    EXPECT_EQ(degrees("sh", {0, 1000, 2000, 3000, 4000, 6000}, {1000, 2000}), (std::vector<int>{0, 0, 0, 1, 2, 3}));
    EXPECT_EQ(degrees("sv", {0, 1000, 2000, 3000}, {1000, 2000}), (std::vector<int>{7, 0, 0, 7}));
    EXPECT_EQ(degrees("sh", {1000, 1500, 2000}, {1500}), (std::vector<int>{1, 1, 2})) << "only where it would rise";
}

TEST(DegreeSchedule, GoesOnFromTheDegreeOfACheckpoint) {
    TrainOptions o;
    o.source = "x", o.strategy = Strategy::kNone;
    o = resolve(o);
    DensificationSchedule schedule(o, appearance_spec(o), 1, true, {});
    const auto backend = make_cpu_backend(appearance_spec(o));
    schedule.resume(1);  // it was held once
    schedule.before_step(*backend, moment_at(o, 3000));
    EXPECT_EQ(schedule.active_degree(), 2);
}

// Which images a rank decodes, and when.

constexpr int kNumViews = 40, kSize = 4;

/// A scene whose views count how often they were decoded.
struct CountedScene {
    std::array<std::atomic<int>, kNumViews> decodes{};
    Scene scene;

    CountedScene() {
        for (int k = 0; k < kNumViews; ++k) {
            View view;
            view.name = std::to_string(k);
            view.camera.width = view.camera.height = kSize;
            view.load = [this, k] {
                ++decodes[std::size_t(k)];
                ViewImage image;
                image.color.width = image.color.height = kSize, image.color.channels = 3;
                image.color.u8.assign(3 * kSize * kSize, std::uint8_t(k));
                return image;
            };
            scene.train.push_back(std::move(view));
        }
    }
};

TEST(TrainingViews, AreDecodedAheadByTheRankThatRendersThemFromItsFirstOn) {
    CountedScene counted;
    TrainOptions options;
    options.device = Device::kCpu;
    TrainingViews views(options, counted.scene);
    views.set_views_per_step(2, [](int k) { return k == 1; });  // the second of two ranks
    ViewOrder order(kNumViews, options.seed);
    const auto decodes_at = [&](std::int64_t position) { return counted.decodes[order.at(position)].load(); };
    const auto image = views.image_of_rank({int(order.at(1))}, 1);
    EXPECT_EQ(image->color.u8[0], order.at(1));
    using Clock = std::chrono::steady_clock;
    for (const auto end = Clock::now() + std::chrono::seconds(20); decodes_at(5) == 0 && Clock::now() < end;)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    for (const int own : {1, 3, 5}) EXPECT_EQ(decodes_at(own), 1) << own;
    for (const int of_the_other : {0, 2, 4, 6}) EXPECT_EQ(decodes_at(of_the_other), 0) << of_the_other;
}

}  // namespace
}  // namespace gs::test
