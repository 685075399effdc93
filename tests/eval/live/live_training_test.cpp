// SPDX-License-Identifier: Apache-2.0
// A training under the eyes of a page: the same as without, and it does what the page asks for.
#include "apps/gsapp/live/live_training.h"

#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/export/ngsplat.h"
#include "lib/export/site.h"
#include "lib/model/run_folder.h"
#include "lib/scene/scene.h"
#include "tests/core/temporary_folder.h"
#include "tests/export/http_client.h"

namespace gs::test {
namespace {

class Watched : public ::testing::Test {
  protected:
    void SetUp() override {
        if (viewer_folder().empty()) GTEST_SKIP() << "the viewer is not built (scripts/build-viewer)";
    }
    TrainOptions options(const std::string& run, std::int64_t iterations) const {
        TrainOptions o;
        o.source = "builtin:glossy";
        o.resolution = 8;
        o.device = Device::kCpu;  // whose results are the same to the bit
        o.eval = true;
        o.iterations = iterations;
        o.init_points = 300, o.cap_max = 400;
        o.quiet = true;
        o.model = (folder_.path() / run).string();
        o = resolve(o);
        return o;
    }
    static std::string bytes(const std::filesystem::path& file) {
        std::ifstream in(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
    /// Trains under the eyes of `watch`, which gets the port and the token, in a thread of its own.
    template <class Watch> void train_watched(const TrainOptions& o, Watch watch) {
        train_watched(o, load_scene(o), watch);
    }
    template <class Watch> void train_watched(const TrainOptions& o, Scene scene, Watch watch) {
        LiveTraining live(o, scene, 0);
        const std::string address = live.address();
        const int port = std::stoi(address.substr(address.rfind(':') + 1));
        std::thread watcher([&] { watch(port, address.substr(address.find("token=") + 6)); });
        // Not before the page looks, so that it sees all of the course.
        while (live_status(port)["state"] != "starting") std::this_thread::yield();
        TrainHooks hooks;
        hooks.between = [&](const TrainProgress& now, Backend& backend) { return live.between(now, backend); };
        hooks.saved = [&](std::int64_t at, const std::string& error) { live.saved(at, error); };
        hooks.evaluate = [&](std::int64_t at, Backend& backend, bool last) {
            if (last) live.finish(at, backend);
            return std::nullopt;
        };
        Progress progress(ProgressStyle::kSilent);
        std::exception_ptr error;
        try {
            train(o, scene, open_run(o), progress, hooks);
        } catch (const std::exception& e) {
            error = std::current_exception();
            live.end(dynamic_cast<const Interrupted*>(&e) ? "stopped" : "failed", e.what());
        }
        watcher.join();
        if (error) std::rethrow_exception(error);
    }
    static nlohmann::json live_status(int port) {
        return nlohmann::json::parse(http_get(port, "/live/status.json").body, nullptr, false);
    }
    static void press(int port, const std::string& name, const std::string& token) {
        EXPECT_EQ(
            http_get(port, "/live/" + name, "X-Gsapp-Token: " + token + "\r\nContent-Length: 0\r\n", "POST").status,
            200);
    }
    /// Asks until `is` holds for the answer.
    template <class Is> static nlohmann::json wait_for(int port, Is is) {
        for (int k = 0; k < 6000; ++k) {
            const nlohmann::json json = live_status(port);
            if (is(json)) return json;
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        }
        ADD_FAILURE() << live_status(port).dump();
        return {};
    }

    TemporaryFolder folder_;
};

TEST_F(Watched, IsTheSameAsUnwatchedToTheBit) {
    const TrainOptions alone = options("alone", 300), seen = options("seen", 300);
    Progress progress(ProgressStyle::kSilent);
    Scene scene = load_scene(alone);
    train(alone, scene, open_run(alone), progress, {});
    int snapshots = 0;
    train_watched(seen, [&](int port, const std::string& token) {
        press(port, "save", token);
        const auto last = wait_for(port, [](const auto& s) {
            return s.value("state", "") == "finished" && !s["model"].is_null() && s["model"]["iteration"] == 300;
        });
        snapshots = last["model"]["version"];
        folder_.write("last.ngsplat", http_get(port, "/" + last["model"]["url"].get<std::string>()).body);
        EXPECT_GE(last["psnr_curve"]["values"].size(), 1u);
        EXPECT_EQ(last["loss_curve"]["values"].size(), 3u);
        EXPECT_EQ(last["saved_iteration"], 0) << "where the model could be read without changing anything";
    });
    EXPECT_GE(snapshots, 2) << "one at the beginning and one at the end";
    const RunFolder a{alone.model}, b{seen.model};
    EXPECT_EQ(bytes(a.point_cloud(300)), bytes(b.point_cloud(300)));
    EXPECT_TRUE(std::filesystem::exists(b.checkpoint(0))) << "that the page asked for";
    const PackedScene shown = read_ngsplat(folder_.path() / "last.ngsplat");
    EXPECT_GT(shown.count(), 0);
    EXPECT_GT(shown.cameras.size(), 0u);
    for (const auto& entry : std::filesystem::directory_iterator(seen.model))
        EXPECT_EQ(entry.path().filename().string().find("live"), std::string::npos) << "snapshots are gone";
}

TEST_F(Watched, TrainsOnWhereNothingCanBeShown) {
    const TrainOptions o = options("blind", 200);
    Scene scene = load_scene(o);
    for (View& view : scene.test) {
        view.decoded = nullptr;
        view.load = []() -> ViewImage { throw DataError("photograph gone"); };
    }
    train_watched(o, scene, [&](int port, const std::string&) {
        const auto last =
            wait_for(port, [](const auto& s) { return s.value("state", "") == "finished" && !s["model"].is_null(); });
        EXPECT_TRUE(last["psnr_curve"]["values"].empty());
    });
    EXPECT_EQ(latest_point_cloud(o.model), 200);
}

TEST_F(Watched, SaysWhyItFailed) {
    const TrainOptions o = options("failed", 1'000'000);
    Scene scene = load_scene(o);
    std::atomic<int> loads = 0;
    for (View& view : scene.train) {
        view.decoded = nullptr;
        view.load = [&loads, load = view.load] {
            if (++loads > 5) throw DataError("photograph gone");
            return load();
        };
    }
    const auto watch = [&](int port, const std::string&) {
        const auto last = wait_for(port, [](const auto& s) { return s.value("state", "") == "failed"; });
        EXPECT_NE(last.value("message", "").find("photograph gone"), std::string::npos) << last.dump();
    };
    EXPECT_THROW(train_watched(o, scene, watch), DataError);
}

TEST_F(Watched, PausesAndStops) {
    const TrainOptions o = options("stopped", 1'000'000);
    const auto watch = [&](int port, const std::string& token) {
        wait_for(port, [](const auto& s) { return s["iteration"] > 20; });
        press(port, "pause", token);
        const auto paused = wait_for(port, [](const auto& s) { return s["state"] == "paused"; });
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
        const auto still = live_status(port);
        EXPECT_EQ(still["iteration"], paused["iteration"]);
        EXPECT_EQ(still["train_seconds"], paused["train_seconds"]) << "a pause is no training";
        press(port, "continue", token);
        wait_for(port, [&](const auto& s) { return s["iteration"] > paused["iteration"]; });
        press(port, "pause", token);
        wait_for(port, [](const auto& s) { return s["state"] == "paused"; });
        press(port, "stop", token);  // also of a training that pauses
        wait_for(port, [](const auto& s) { return s["state"] == "stopped"; });
    };
    EXPECT_THROW(train_watched(o, watch), Interrupted);
    EXPECT_NO_THROW(latest_checkpoint(o.model)) << "as with Ctrl-C";
}

}  // namespace
}  // namespace gs::test
