// SPDX-License-Identifier: Apache-2.0
// How views are corrected when they are scored: what the renderer is asked for, colour fits, and what the results say.
#include "eval/runs/evaluate.h"

#include <gtest/gtest.h>
#include <cmath>
#include <nlohmann/json.hpp>

#include "eval/metrics/pixel_metrics.h"
#include "eval/metrics/quantize.h"
#include "eval/report/comparison.h"
#include "eval/runs/decompose.h"
#include "eval/runs/protocol.h"
#include "eval/runs/results.h"
#include "eval/runs/saved_run.h"
#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/model/ply.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"

namespace gs {
namespace {

float random_value(int view, int k) {
    return uniform_from_bits(philox(5, RngStream::kScene, std::uint64_t(view), std::uint32_t(k)).v[0]);
}

/// Paints random colours that depend on the camera, and remembers the requested corrections.
class RandomEngine : public test::FakeEngine {
  public:
    void render(const RenderRequest& request, const SplatParts*, RenderedImage& out) override {
        out.width = request.camera.width, out.height = request.camera.height;
        out.rgb.clear();
        for (int k = 0; k < 3 * out.width * out.height; ++k)
            out.rgb.push_back(random_value(int(request.camera.translation.x), k));
        out.alpha.assign(out.rgb.size() / 3, 1);
        asked.push_back(request.isp);
    }
    std::vector<IspView> asked;
};

/// Returns views whose photographs are RandomEngine's pictures, dimmed by `factor(view)` and with 0.1 added to red.
std::vector<View> dimmed_views(const std::function<float(int)>& factor) {
    std::vector<View> views(3);
    for (int v = 0; v < 3; ++v) {
        View& view = views[std::size_t(v)];
        view.name = std::to_string(v);
        view.camera.width = 16, view.camera.height = 12;
        view.camera.translation.x() = v;
        view.load = [v, f = factor(v)] {
            ViewImage image;
            image.color = {16, 12, 3, {}, {}};
            for (int i = 0; i < 16 * 12; ++i)
                for (int c = 0; c < 3; ++c)
                    image.color.f32.push_back(f * random_value(v, c * 16 * 12 + i) + (c == 0 ? 0.1f : 0.0f));
            return image;
        };
    }
    return views;
}

double score(const std::vector<View>& views, CorrectionMode mode) {
    test::BackendOf<RandomEngine> backend;
    EvalOptions options;
    options.correction.mode = mode;
    return evaluate_views(backend, views, {0, 0, 0}, options).psnr;
}

TEST(EvalCorrection, ColourAlignedFitsEachViewAndSceneAlignedAllAtOnce) {
    const auto same = dimmed_views([](int) { return 0.5f; }),
               different = dimmed_views([](int v) { return 0.2f + 0.35f * float(v); });
    for (const CorrectionMode mode : {CorrectionMode::kOff, CorrectionMode::kNone, CorrectionMode::kController})
        EXPECT_LT(score(same, mode), 15);
    EXPECT_GT(score(same, CorrectionMode::kSceneAligned), 50);
    EXPECT_GT(score(same, CorrectionMode::kColourAligned), 50);
    EXPECT_LT(score(different, CorrectionMode::kSceneAligned), 25);
    EXPECT_GT(score(different, CorrectionMode::kColourAligned), 50);
}

TEST(ColourFit, OneColourLeavesTheMapOpenButNotTheResult) {
    RenderedImage render{2, 1, {0.5f, 0.5f, 0.25f, 0.25f, 0.f, 0.f}, {1, 1}};
    ColourFit fit;
    fit.add(render, {2, 1, 3, {51, 102, 0, 51, 102, 0}, {}});
    apply_colours(fit.solve(), render);
    EXPECT_NEAR(render.rgb[0], 0.2, 1e-6);
    EXPECT_NEAR(render.rgb[3], 0.4, 1e-6);
    EXPECT_NEAR(render.rgb[5], 0, 1e-6);
}

TEST(EvalCorrection, RendererIsAskedForWhatTheModeSays) {
    View view;
    view.camera_id = 2;
    view.exif_exposure = -6;
    EXPECT_EQ(view_isp(view, {}).mode, IspMode::kNone);
    for (const CorrectionMode mode :
         {CorrectionMode::kNone, CorrectionMode::kColourAligned, CorrectionMode::kSceneAligned}) {
        EXPECT_EQ(view_isp(view, {mode}).mode, IspMode::kFrame);
        EXPECT_EQ(view_isp(view, {mode}).frame, -1) << "neutral";
        EXPECT_EQ(view_isp(view, {mode}).camera, 2);
    }
    const IspView controlled = view_isp(view, {CorrectionMode::kController, true, -7.5});
    EXPECT_EQ(controlled.mode, IspMode::kController);
    EXPECT_EQ(controlled.prior_exposure, 1.5f);
    EXPECT_EQ(view_isp(view, {CorrectionMode::kController, false, -7.5}).prior_exposure, 0);
    view.exif_exposure.reset();
    view.camera_id = -1;
    EXPECT_EQ(view_isp(view, {CorrectionMode::kController, true, -7.5}).prior_exposure, 0) << "unknown: as the mean";
    EXPECT_EQ(view_isp(view, {CorrectionMode::kController, true, -7.5}).camera, 0) << "unknown: the first";
}

TEST(EvalCorrection, BaseIsCorrectedAndResidualNot) {
    const IspView isp{.mode = IspMode::kController};
    EXPECT_EQ(part_request({}, {}, RenderMode::kFull, isp).isp.mode, IspMode::kController);
    EXPECT_EQ(part_request({}, {}, RenderMode::kBaseOnly, isp).isp.mode, IspMode::kController);
    EXPECT_EQ(part_request({}, {}, RenderMode::kResidualOnly, isp).isp.mode, IspMode::kNone);
}

TEST(EvalCorrection, WordsOfTheCommandLine) {
    using M = CorrectionMode;
    EXPECT_EQ(choose_correction("", M::kController), M::kController);
    EXPECT_EQ(choose_correction("none", M::kController), M::kNone);
    EXPECT_EQ(choose_correction("none", M::kOff), M::kOff);
    EXPECT_EQ(choose_correction("colour-aligned", M::kOff), M::kColourAligned);
    EXPECT_EQ(choose_correction("scene-aligned", M::kNone), M::kSceneAligned);
    EXPECT_THROW(choose_correction("controller", M::kNone), UsageError);
    EXPECT_THROW(choose_correction("off", M::kNone), UsageError);
    EXPECT_THROW(choose_correction("best", M::kNone), UsageError);
}

TEST(EvalCorrection, StandsBesideTheScores) {
    const test::TemporaryFolder folder;
    EvalOptions options;
    options.correction = {CorrectionMode::kController, true, 0};
    RunResult result;
    result.iteration = 3;
    result.views = {{"a.png", 30, 0.9, 0.1}};
    result.controller_seconds = 2.5;
    result.photometric = "on: because";
    const auto write = [&] {
        result.protocol = protocol_json(options, {0, 0, 0}, 1);
        write_results(RunFolder{folder.path()}, result);
    };
    write();
    result.controller_seconds.reset();
    result.photometric.reset();
    const auto stored = [&] { return parse_json(read_input(folder.path() / "results.json")); };
    write();
    auto json = stored();
    EXPECT_EQ(json["protocol"]["ours_3"]["ppisp_eval"], "controller");
    EXPECT_NE(json["protocol"]["ours_3"]["photometric"].get<std::string>().find("EXIF"), std::string::npos);
    EXPECT_EQ(json["timing"]["ours_3"]["controller_seconds"], 2.5) << "an earlier value stays";
    EXPECT_EQ(json["photometric"]["ours_3"]["decision"], "on: because");
    EXPECT_EQ(read_results(folder.path(), 3).correction(), "controller");
    options.correction.mode = CorrectionMode::kColourAligned;
    write();
    json = stored();
    EXPECT_NE(json["protocol"]["ours_3"]["photometric"].get<std::string>().find("uses the test images"),
              std::string::npos);
    EXPECT_EQ(json["protocol"]["ours_3"]["images"].get<std::string>().find("no colour alignment"), std::string::npos);
    EXPECT_NE(format_comparison(compare_runs({read_results(folder.path(), 3)}), TableFormat::kMarkdown)
                  .find("| colour-aligned |"),
              std::string::npos);
}

TEST(EvalCorrection, ASavedModelComesWithItsCorrection) {
    const test::TemporaryFolder folder;
    Gaussians g;
    g.count = 1;
    g.appearance = {"none", 0, ColorActivation::kRelu};
    g[Group::kMean] = {3, {0, 0, 0.3f}, {}, {}};
    g[Group::kScale] = {3, {-1, -1, -1}, {}, {}};
    g[Group::kRotation] = {4, {1, 0, 0, 0}, {}, {}};
    g[Group::kOpacity] = {1, {5}, {}, {}};
    g[Group::kBase] = {3, {0.4f, -0.5f, -0.5f}, {}, {}};
    const RunFolder names{folder.path()};
    write_ply(names.point_cloud(10), g, {});
    EXPECT_EQ(read_saved_model(folder.path(), {}).correction.mode, CorrectionMode::kOff);
    PpispFile file;
    file.iteration = 10;
    file.exif = true;
    file.mean_exif = -3;
    file.frames = {{"a.png", 0}};
    file.state = identity_ppisp(1, 1);
    file.state.param[0] = 0.75f;
    write_ppisp_json(names.ppisp(), file);
    SavedModel model = read_saved_model(folder.path(), {});
    EXPECT_EQ(model.correction.mode, CorrectionMode::kNone) << "no controller was trained";
    EXPECT_EQ(model.state.ppisp.param[0], 0.75f);
    file.state.controller.resize(kControllerWeights);
    write_ppisp_json(names.ppisp(), file);
    model = read_saved_model(folder.path(), {});
    EXPECT_EQ(model.correction.mode, CorrectionMode::kController);
    EXPECT_EQ(model.correction.mean_exif, -3);
    EXPECT_TRUE(model.correction.exif);
}

// Protocols in words, and what they do to scores.

constexpr Vec3<float> kBlack{0, 0, 0};

TEST(Protocol, ThePapersIsTheDefaultAndNamesAreKnown) {
    EXPECT_EQ(protocols().front().name, "paper");
    EXPECT_EQ(EvalOptions{}.protocol.name, "paper");
    EXPECT_TRUE(is_protocol("gsplat"));
    EXPECT_FALSE(is_protocol("brush"));
    try {
        find_protocol("brush");
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("paper, inria, gsplat"), std::string::npos) << e.what();
    }
}

TEST(Protocol, OneLineSaysEverythingAndWhatDeviates) {
    EXPECT_EQ(protocol_line(find_protocol("paper"), kBlack),
              "protocol paper: images_N as shipped, else area resize; 8 bits; SSIM windows inside the image; "
              "LPIPS-VGG, inputs in [-1,1]; background "
              "black; mean over images");
    const std::string white = protocol_line(find_protocol("paper"), {1, 1, 1});
    EXPECT_NE(white.find("background white as trained (instead of black)"), std::string::npos) << white;
    EXPECT_EQ(protocol_line(find_protocol("inria"), kBlack), protocol_line(find_protocol("inria"), {1, 1, 1}))
        << "3DGS takes what -w says";
    const std::string gsplat = protocol_line(find_protocol("gsplat"), kBlack);
    for (const char* part : {"float in [0,1]", "mirrored", "LPIPS-Alex", "deviation: ", "PIL bicubic"})
        EXPECT_NE(gsplat.find(part), std::string::npos) << gsplat;
    Protocol zero = find_protocol("paper");
    zero.ssim_border = SsimBorder::kZero;
    EXPECT_NE(protocol_line(zero, kBlack).find("zero padding (--ssim-border, instead of windows inside the image)"),
              std::string::npos);
    for (const Protocol& p : protocols()) EXPECT_EQ(protocol_line(p, kBlack).find('\n'), std::string::npos);
}

/// The fake backend paints red = x of the camera's place.
View view_of(float red, std::uint8_t photograph) {
    View view;
    view.name = "v";
    view.camera.width = 16, view.camera.height = 12;
    view.camera.translation.x() = red;
    view.load = [photograph] {
        Image image{16, 12, 3, {}, {}};
        for (int i = 0; i < 16 * 12; ++i) image.u8.insert(image.u8.end(), {photograph, 0, 0});
        return ViewImage{image, std::nullopt};
    };
    return view;
}

double psnr_under(const char* protocol, float red, std::uint8_t photograph) {
    test::BackendOf<test::FakeEngine> backend;
    EvalOptions options;
    options.protocol = find_protocol(protocol);
    return evaluate_views(backend, {view_of(red, photograph)}, kBlack, options).psnr;
}

TEST(Protocol, EightBitsRoundAndFloatDoesNot) {
    const float almost = 100.3f / 255;
    EXPECT_TRUE(std::isinf(psnr_under("paper", almost, 100))) << "rounds to the photograph";
    const double error = almost - 100.0 / 255;
    EXPECT_NEAR(psnr_under("gsplat", almost, 100), -10 * std::log10(error * error / 3), 1e-3);
    EXPECT_TRUE(std::isinf(psnr_under("gsplat", 1.5f, 255))) << "clamped";
}

TEST(Protocol, TheSsimBorderIsTheProtocols) {
    test::BackendOf<test::FakeEngine> backend;
    const auto ssim_under = [&](const char* protocol) {
        EvalOptions options;
        options.protocol = find_protocol(protocol);
        return evaluate_views(backend, {view_of(0.25f, 191)}, kBlack, options).ssim;
    };
    EXPECT_NEAR(ssim_under("paper"), ssim_under("gsplat"), 1e-2) << "of constant images only the rounding differs";
    EXPECT_GT(std::abs(ssim_under("paper") - ssim_under("inria")), 1e-4) << "zeros outside are seen";
}

TEST(Protocol, FloatTargetsAreCompositedToo) {
    test::BackendOf<test::FakeEngine> backend;
    View view = view_of(0.5f, 0);
    view.load = [] {
        Image image{16, 12, 4, {}, {}};
        for (int i = 0; i < 16 * 12; ++i) image.f32.insert(image.f32.end(), {1.0f, 0.0f, 0.0f, 0.5f});
        return ViewImage{image, std::nullopt};
    };
    EvalOptions options;
    options.protocol = find_protocol("gsplat");
    EXPECT_TRUE(std::isinf(evaluate_views(backend, {view}, kBlack, options).psnr));
}

}  // namespace
}  // namespace gs
