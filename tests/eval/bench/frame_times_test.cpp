// SPDX-License-Identifier: Apache-2.0
// What the frame time protocol asks a backend for, its statistics, and its table.
#include "eval/bench/frame_times.h"

#include <gtest/gtest.h>

#include "tests/eval/support/fake_engine.h"

namespace gs {
namespace {

/// Says that frames of a view take as many seconds as its camera stands to the right.
class TimedEngine : public test::FakeEngine {
  public:
    void render(const RenderRequest& request, const SplatParts*, RenderedImage& out) override {
        warm_ups += request.camera.translation.x;
        out.width = request.camera.width;
    }
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        EXPECT_EQ(views.size(), 1u);
        EXPECT_EQ(warm_ups, 21) << "every view was seen before the first is timed";
        request = views.at(0), frames = repeats;
        return views[0].camera.translation.x;
    }
    double warm_ups = 0;
    RenderRequest request;
    int frames = 0;
};

TEST(FrameTimes, AreStatisticsOverTheMeansOfViews) {
    std::vector<Camera> cameras(4);
    for (Camera& camera : cameras)
        camera.width = 800, camera.height = 600, camera.fx = camera.fy = 700, camera.cx = 390, camera.cy = 300;
    const double x[] = {9, 2, 4, 6};
    for (int k = 0; k < 4; ++k) cameras[k].translation.x() = x[k];
    test::BackendOf<TimedEngine> backend;
    const FrameTimes times = measure_frame_times(backend, cameras, {0, 1, 0}, 5);
    EXPECT_EQ(times.device, "fake");
    EXPECT_EQ(times.num_views, 4);
    EXPECT_EQ(times.frames_per_view, 5);
    EXPECT_EQ(times.mean, 5.25);
    EXPECT_EQ(times.median, 5);
    EXPECT_EQ(times.min, 2);
    EXPECT_EQ(times.max, 9);
    EXPECT_EQ(backend->frames, 5);
    EXPECT_EQ(backend->request.camera.width, 1280);
    EXPECT_EQ(backend->request.camera.height, 720);
    EXPECT_EQ(backend->request.camera.fx, 700) << "cropped or extended, not rescaled";
    EXPECT_EQ(backend->request.camera.cx, 630);
    EXPECT_EQ(backend->request.background.y, 1);
    EXPECT_EQ(backend->request.isp.mode, IspMode::kNone) << "no PPISP";
    cameras.resize(1), cameras[0].translation.x() = 21, backend->warm_ups = 0;
    EXPECT_EQ(measure_frame_times(backend, cameras, {0, 1, 0}, 1).median, 21);

    const std::string text = markdown_table(frame_times_table({{"a|b", "lego", "sh", 7, times}}));
    EXPECT_NE(text.find("| a\\|b | lego  | sh    | fake   |   7 |     4 |             5 | 5250.000 |  5000.000 | "
                        "2000.000 | 9000.000 |\n"),
              std::string::npos)
        << text;
}

}  // namespace
}  // namespace gs
