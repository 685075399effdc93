// SPDX-License-Identifier: Apache-2.0
#include "eval/bench/precision.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "kernels/reference_image.h"
#include "lib/core/options.h"
#include "lib/scene/camera_params.h"
#include "lib/train/scene_options.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

TrainOptions small_run() {
    TrainOptions o;
    o.source = "builtin:glossy", o.model = "unused", o.device = Device::kCpu, o.resolution = 60, o.eval = true;
    validate(o);
    return o;
}

TEST(Precision, LevelsAreNamedOnceAndDiffer) {
    std::set<std::string> names;
    std::set<std::map<std::string, std::string>> settings;
    for (const PrecisionLevel& level : precision_levels()) {
        TrainOptions o = small_run();
        level.apply(o);
        EXPECT_NO_THROW(validate(o)) << level.name;
        EXPECT_TRUE(names.insert(level.name).second) << level.name;
        EXPECT_TRUE(settings.insert(training_options(o)).second) << level.name;
    }
    EXPECT_TRUE(settings.contains(training_options(small_run()))) << "none is the default";
    try {
        precision_level("quick");
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("'quick' is not one of full, fp32-moments"), std::string::npos)
            << e.what();
    }
}

TEST(Precision, OnTheCpuIsThatOfItsCutoffs) {
    const TrainOptions options = small_run();
    const Scene scene = load_scene(scene_options(options));
    Gaussians model = initial_model(options, scene);
    for (float& x : model[Group::kOpacity].param) x = 0.5f;  // enough light is cut off that it shows
    const auto rows = measure_precision(options, scene, model, {.repeat = 2, .frame_repeat = 1});
    ASSERT_EQ(rows.size(), 2u);
    EXPECT_EQ(rows[0].name, "full");
    EXPECT_EQ(rows[1].name, "cutoffs");
    for (const PrecisionRow& row : rows) {
        EXPECT_GT(row.frame_seconds, 0);
        EXPECT_GT(row.iteration_seconds, 0);
        EXPECT_GT(row.mean_error, 0);
        EXPECT_LE(row.mean_error, row.largest_error);
    }
    EXPECT_LT(rows[0].mean_error, 1e-3);
    EXPECT_GT(rows[1].mean_error, 10 * rows[0].mean_error);
    EXPECT_GT(rows[0].psnr, rows[1].psnr + 10);
    EXPECT_LT(rows[1].largest_error, 255 * 0.5);
    EXPECT_EQ(precision_table(rows).lines.size(), 2u);
}

TEST(Precision, TheReferenceRendersEveryMode) {
    const TrainOptions options = small_run();
    const Scene scene = load_scene(scene_options(options));
    const Gaussians model = initial_model(options, scene);
    const auto backend = make_cpu_backend(model.appearance);
    backend->upload(model);
    for (const RenderMode mode : {RenderMode::kFull, RenderMode::kBaseOnly}) {
        RenderRequest request{
            .camera = camera_params(scene.test.front().camera), .background = {0.2f, 0.4f, 0.6f}, .mode = mode};
        RenderedImage image;
        backend->render(request, image);
        const std::vector<double> reference = render_in_double(model, request);
        ASSERT_EQ(reference.size(), image.rgb.size());
        double mean = 0;
        for (std::size_t i = 0; i < reference.size(); ++i)
            mean += std::abs(reference[i] - image.rgb[i]) / double(reference.size());
        EXPECT_LT(mean, 1e-5);
    }
}

}  // namespace
}  // namespace gs::test
