// SPDX-License-Identifier: Apache-2.0
// Photometric correction through the training loop: what is recovered, resuming, taking over another run's values.
#include "lib/train/photometric.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/scene/procedural.h"
#include "lib/train/trainer.h"
#include "tests/core/temporary_folder.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

const bool quiet = (spdlog::set_level(spdlog::level::err), true);

/// Returns a built-in scene with few of its points: small images need no more.
Scene builtin(const std::string& name, int width) {
    SceneOptions options;
    options.resolution = width;
    Scene scene = load_builtin_scene(name, options);
    scene.points.positions.resize(400), scene.points.colors.resize(400);
    return scene;
}

TrainOptions options_for(const std::filesystem::path& folder, std::int64_t iterations) {
    TrainOptions o;
    o.source = "builtin:exposure";
    o.model = folder.string();
    o.iterations = iterations;
    o.device = Device::kCpu;
    o.cap_max = 500;
    o.ppisp = PpispMode::kOn;
    o.controller_iterations = 0;
    o.schedule = ScheduleKind::kFixed;  // parts of a run, which have other lengths, follow the same schedule
    o = resolve(o);
    return o;
}

TrainSummary run(const TrainOptions& options, Scene scene) {
    Progress progress(ProgressStyle::kSilent);
    return train(options, scene, open_run(options), progress, {});
}

PpispFile result(const TrainOptions& o) { return read_ppisp_json(RunFolder{o.model}.ppisp()); }

std::string bytes_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
    double ma = 0, mb = 0, ab = 0, aa = 0, bb = 0;
    for (std::size_t k = 0; k < a.size(); ++k) ma += a[k] / double(a.size()), mb += b[k] / double(b.size());
    for (std::size_t k = 0; k < a.size(); ++k)
        ab += (a[k] - ma) * (b[k] - mb), aa += (a[k] - ma) * (a[k] - ma), bb += (b[k] - mb) * (b[k] - mb);
    return ab / std::sqrt(aa * bb);
}

template <class Error> std::string message_of(const std::function<void()>& action) {
    try {
        action();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

TEST(PhotometricOptions, ConflictsAreNamed) {
    const auto message = [](auto change) {
        TrainOptions o;
        o.source = "x";
        change(o);
        const std::string text = message_of<UsageError>([&] { o = resolve(o); });
        return text.empty() ? "ppisp " + word(o.ppisp) : text;
    };
    EXPECT_EQ(message([](TrainOptions&) {}), "ppisp off");
    EXPECT_EQ(message([](TrainOptions& o) { o.ppisp_from = "a.json"; }), "ppisp on");
    EXPECT_NE(message([](TrainOptions& o) { o.ppisp_from = "a.json", o.ppisp = PpispMode::kAuto; }).find("ppisp-from"),
              std::string::npos);
    EXPECT_NE(message([](TrainOptions& o) { o.ppisp_exif = true; }).find("ppisp-exif"), std::string::npos);
    EXPECT_EQ(message([](TrainOptions& o) { o.ppisp_exif = true, o.ppisp = PpispMode::kAuto; }), "ppisp auto");
}

TEST(PhotometricRate, StartsSlowlyAndFallsByAHundred) {
    EXPECT_DOUBLE_EQ(ppisp_rate(0.002, 0), 0.002 * 0.01);
    EXPECT_DOUBLE_EQ(ppisp_rate(0.002, -5000), 0.002 * 0.01) << "a schedule that went back";
    EXPECT_DOUBLE_EQ(ppisp_rate(0.002, 250), 0.002 * (0.01 + 0.99 / 2));
    EXPECT_DOUBLE_EQ(ppisp_rate(0.002, 500), 0.002);
    EXPECT_NEAR(ppisp_rate(0.002, 30500), 0.002 * 0.01, 1e-12);
    EXPECT_NEAR(ppisp_rate(0.002, 30000), 2.16e-5, 1e-7);
}

// 40 views of 32x24 pixels that differ by up to one stop either way. A frame is seen every 40 steps, and gets there
// slowly.
TEST(Photometric, RecoversTheExposuresOfTheScene) {
    const test::TemporaryFolder tmp;
    const Scene scene = builtin("exposure", 32);
    const TrainOptions o = options_for(tmp.path() / "run", 4000);
    run(o, scene);
    const PpispFile file = result(o);
    std::vector<double> found, truth;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        EXPECT_EQ(file.frames[k].image, scene.train[k].name);
        found.push_back(file.state.param[k * kIspFrameValues]);
        truth.push_back(*scene.train[k].exif_exposure);
    }
    EXPECT_GT(correlation(found, truth), 0.99);
    // View dependence waited: it could have begun at 1000, and did at the first thousand after a third of the run.
    std::ifstream log(RunFolder{o.model}.train_log());
    std::map<std::int64_t, int> degrees;
    for (std::string line; std::getline(log, line);)
        if (const auto event = parse_json(line); event.at("event") == "step")
            degrees[event.at("iteration")] = event.at("active_degree");
    EXPECT_EQ(degrees.at(1100), 0);
    EXPECT_EQ(degrees.at(1900), 0);
    EXPECT_EQ(degrees.at(2100), 1);
}

/// Holds PPISP in which frames 0, 1, ... have the exposures of a list in turn.
class ExposedEngine : public test::ForwardingEngine {
  public:
    explicit ExposedEngine(std::vector<float> exposures)
        : ForwardingEngine({"none", 0, ColorActivation::kRelu}), exposures_(std::move(exposures)) {}
    void upload_ppisp(const PpispState&) override {}
    Gaussians download(Download) override {
        Gaussians model;
        model.ppisp = identity_ppisp(40, 1);
        for (std::size_t k = 0; k < 40; ++k) model.ppisp.param[k * kIspFrameValues] = exposures_[k % exposures_.size()];
        return model;
    }

  private:
    std::vector<float> exposures_;
};

TEST(Photometric, ViewDependenceWaitsWhereExposuresDiffer) {
    const test::TemporaryFolder tmp;
    const Scene scene = builtin("exposure", 16);
    TrainOptions o = options_for(tmp.path() / "run", 60000);
    test::BackendOf<ExposedEngine> varied(std::vector{0.5f, -0.5f, 0.1f}),
        steady(std::vector{1.05f, 0.95f});  // a common exposure is not a difference
    const auto holds = [&](Backend& backend, std::int64_t iteration) {
        return Photometric(o, scene).holds_view_dependence(backend, moment_at(o, iteration));
    };
    EXPECT_TRUE(holds(varied, 1000));
    EXPECT_TRUE(holds(varied, 9999));
    EXPECT_FALSE(holds(varied, 10000)) << "not for ever";
    EXPECT_FALSE(holds(steady, 1000));
    o.iterations = 3000, o.schedule = ScheduleKind::kProgress;
    EXPECT_TRUE(holds(varied, 999));
    EXPECT_FALSE(holds(varied, 1000)) << "a third of the run";
    o.ppisp = PpispMode::kOff;
    EXPECT_FALSE(holds(varied, 500));
}

TEST(Photometric, OneImageCanBeCorrected) {
    const test::TemporaryFolder tmp;
    Scene scene = builtin("exposure", 16);
    scene.train.resize(1);
    TrainOptions o = options_for(tmp.path() / "on", 5);
    run(o, scene);
    EXPECT_EQ(result(o).frames.size(), 1u);
}

TEST(Photometric, ImagesOfOneCameraMayDifferInSize) {
    const test::TemporaryFolder tmp;
    Scene scene = builtin("exposure", 24);
    const Scene other = builtin("exposure", 16);
    for (std::size_t k = 0; k < scene.train.size(); k += 2) scene.train[k] = other.train[k];
    TrainOptions o = options_for(tmp.path() / "run", 50);
    o.controller_iterations = 4;
    run(o, scene);
    for (const float value : result(o).state.param) EXPECT_TRUE(std::isfinite(value));
}

TEST(Photometric, ExposuresStartFromExif) {
    const test::TemporaryFolder tmp;
    Scene scene = builtin("exposure", 16);
    scene.train[3].exif_exposure.reset();
    TrainOptions o = options_for(tmp.path() / "run", 1);
    o.ppisp_exif = true;
    run(o, scene);
    const PpispFile file = result(o);
    double sum = 0;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        const double exposure = file.state.param[k * kIspFrameValues];
        sum += exposure;
        EXPECT_EQ(file.frames[k].exif_exposure.has_value(), k != 3);
        EXPECT_NEAR(exposure, k == 3 ? 0 : *scene.train[k].exif_exposure - file.mean_exif, 1e-3);
    }
    EXPECT_NEAR(sum, 0, 0.01);
}

void expect_resuming_equals_not_stopping(const TrainOptions& whole, std::int64_t stop,
                                         const std::filesystem::path& folder) {
    const Scene scene = builtin("exposure", 16);
    run(whole, scene);
    TrainOptions part = whole;
    part.model = folder.string();
    part.iterations = stop;
    run(part, scene);
    part.iterations = whole.iterations;
    part.resume = "latest";
    run(part, scene);
    EXPECT_FALSE(bytes_of(RunFolder{whole.model}.ppisp()).empty());
    EXPECT_TRUE(bytes_of(RunFolder{whole.model}.ppisp()) == bytes_of(RunFolder{part.model}.ppisp()))
        << "too long to print";
    EXPECT_TRUE(bytes_of(RunFolder{whole.model}.point_cloud(whole.iterations)) ==
                bytes_of(RunFolder{part.model}.point_cloud(whole.iterations)));
    const Checkpoint a = read_checkpoint(RunFolder{whole.model}.checkpoint(whole.iterations)),
                     b = read_checkpoint(RunFolder{part.model}.checkpoint(whole.iterations));
    EXPECT_EQ(a.state.ppisp.m, b.state.ppisp.m);
    EXPECT_EQ(a.state.ppisp.step, b.state.ppisp.step);
}

TEST(Photometric, ResumingEqualsNotStoppingBitForBit) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "whole", 60);
    o.controller_iterations = 12;
    expect_resuming_equals_not_stopping(o, 37, tmp.path() / "part");
    EXPECT_FALSE(result(o).state.controller.empty());
    EXPECT_TRUE(read_checkpoint(RunFolder{o.model}.checkpoint(60)).state.ppisp.controller.empty())
        << "a longer run goes on without";
}

TEST(Photometric, ACheckpointOfOtherImagesOrWithoutTheOptionIsRefused) {
    const test::TemporaryFolder tmp;
    TrainOptions o = options_for(tmp.path() / "run", 4);
    Scene scene = builtin("exposure", 16);
    run(o, scene);
    o.iterations = 6;
    o.resume = "latest";
    TrainOptions off = o;
    off.ppisp = PpispMode::kOff;
    EXPECT_NE(message_of<UsageError>([&] { run(off, scene); }).find("option ppisp"), std::string::npos);
    scene.train.pop_back();
    EXPECT_NE(message_of<DataError>([&] { run(o, scene); }).find("40 images of 1 cameras, but the scene has 39"),
              std::string::npos);
}

class PpispFrom : public ::testing::Test {
  protected:
    PpispFrom() {
        TrainOptions first = options_for(tmp_.path() / "first", 30);
        first.controller_iterations = 5;
        run(first, scene_);
        source_ = result(first);
        o_ = options_for(tmp_.path() / "second", 20);
        o_.controller_iterations = 5;
        o_.ppisp_from = RunFolder{first.model}.ppisp().string();
    }
    const test::TemporaryFolder tmp_;
    Scene scene_ = builtin("exposure", 16);
    PpispFile source_;
    TrainOptions o_;
};

TEST_F(PpispFrom, ValuesAndControllerStayAsTheyAre) {
    std::swap(scene_.train[2], scene_.train[5]);  // matched by name
    const TrainSummary summary = run(o_, scene_);
    EXPECT_EQ(summary.controller_seconds, 0);
    const PpispFile file = result(o_);
    EXPECT_EQ(file.state.controller, source_.state.controller);
    const auto frame = [](const PpispFile& f, int k) {
        return std::vector(f.state.param.begin() + k * kIspFrameValues,
                           f.state.param.begin() + (k + 1) * kIspFrameValues);
    };
    EXPECT_EQ(frame(file, 2), frame(source_, 5));
    EXPECT_EQ(frame(file, 5), frame(source_, 2));
    EXPECT_EQ(frame(file, 7), frame(source_, 7));
    EXPECT_EQ(std::vector(file.state.param.end() - kIspCameraValues, file.state.param.end()),
              std::vector(source_.state.param.end() - kIspCameraValues, source_.state.param.end()));
}

TEST_F(PpispFrom, ImagesWithoutValuesAreNamed) {
    for (const int k : {1, 4, 6, 9}) scene_.train[std::size_t(k)].name = "other/" + std::to_string(k) + ".png";
    const std::string message = message_of<DataError>([&] { run(o_, scene_); });
    EXPECT_NE(
        message.find("ppisp.json: no values for 4 of 40 training images: other/1.png, other/4.png, other/6.png, ..."),
        std::string::npos)
        << message;
    scene_.num_cameras = 2;
    EXPECT_NE(message_of<DataError>([&] { run(o_, scene_); }).find("1 cameras, but the images of"), std::string::npos);
}

TEST_F(PpispFrom, BothRunsUseExifOrNeither) {
    o_.ppisp_exif = true;
    EXPECT_NE(message_of<UsageError>([&] { run(o_, scene_); }).find("without --ppisp-exif"), std::string::npos);
}

}  // namespace
}  // namespace gs
