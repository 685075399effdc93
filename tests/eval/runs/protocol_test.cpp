// SPDX-License-Identifier: Apache-2.0
// Protocols in words, and what they do to scores.
#include "eval/runs/protocol.h"

#include <gtest/gtest.h>

#include <cmath>

#include "eval/metrics/pixel_metrics.h"
#include "eval/runs/evaluate.h"
#include "kernels/base/error.h"
#include "tests/eval/support/fake_engine.h"

namespace gs {
namespace {

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
