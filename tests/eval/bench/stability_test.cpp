// SPDX-License-Identifier: Apache-2.0
// The stability sweep within its bounds, and whether it would notice a defect.
#include "eval/bench/stability.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "eval/bench/precision.h"
#include "eval/bench/stability_compare.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "kernels/reference_image.h"
#include "lib/core/options.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/scene.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

struct Bounds {
    double forward, backward, ulp, double_error;
};

/// Returns the bounds of a row: two to four times what the sweep shows on x86-64 with glibc, rounded up, and at least
/// 2e-7, 2 ULP and 3e-16. The margin is for compilers that contract other products and for mathematics libraries that
/// round the last digit otherwise. A new model gets the defaults until it has lines of its own.
///
/// The relative errors of thousandths are the problem's own: they end where one rounding of the inputs changes a
/// thousandth (a carrier close to its zeros, views a little more than 1e-6 away).
Bounds bounds(const StabilityRow& row) {
    static const std::map<std::string, Bounds> known = {
        {"relu, base colour", {2e-7, 2e-7, 2, 3e-16}},
        {"relu, initial colour", {2e-7, 2e-7, 2, 3e-16}},
        {"softplus, base colour", {3e-6, 3e-6, 2, 3e-16}},
        {"softplus, initial colour", {2e-5, 2e-7, 4, 3e-16}},
        {"sigmoid, base colour", {2e-7, 2e-7, 2, 3e-16}},
        {"sigmoid, initial colour", {8e-6, 2e-7, 32, 3e-16}},
        {"hardsigmoid, base colour", {2e-7, 2e-7, 2, 3e-16}},
        {"hardsigmoid, initial colour", {2e-7, 2e-7, 2, 3e-16}},
        {"nasg, angles", {7e-6, 6e-5, 8, 1e-15}},
        {"nasg, sharpness", {3e-5, 2e-3, 7, 2e-15}},
        {"nasg, anisotropy", {4e-4, 3e-4, 20, 2e-15}},
        {"nasg, amplitude", {2e-5, 3e-4, 7, 2e-15}},
        {"nasg, base colour", {8e-6, 8e-4, 8, 2e-15}},
        {"nasg, view", {2e-3, 2e-3, 12, 4e-15}},
        {"nasg, on the axis", {2e-6, 2e-6, 5, 1e-15}},
        {"nasg, at the antipode", {3e-6, 3e-6, 3, 9e-16}},
        {"nasg, frames at their limits", {3e-6, 9e-6, 9, 2e-15}},
        {"nasgabor, angles", {6e-4, 3e-3, 20, 4e-15}},
        {"nasgabor, sharpness", {2e-3, 4e-3, 12, 2e-15}},
        {"nasgabor, anisotropy", {3e-3, 3e-3, 14, 4e-15}},
        {"nasgabor, carrier", {5e-4, 5e-4, 15, 5e-15}},
        {"nasgabor, amplitude", {5e-4, 6e-4, 50, 6e-15}},
        {"nasgabor, base colour", {5e-4, 2e-3, 24, 4e-15}},
        {"nasgabor, view", {2e-3, 2e-3, 400, 3e-14}},
        {"nasgabor, on the axis", {2e-6, 2e-6, 5, 2e-15}},
        {"nasgabor, at the antipode", {3e-6, 3e-6, 4, 8e-16}},
        {"nasgabor, frames at their limits", {3e-6, 2e-5, 7, 2e-15}},
        {"neural, features", {8e-6, 3e-6, 4, 7e-16}},
        {"neural, shared weights", {8e-6, 2e-3, 6, 8e-16}},
        {"neural, base colour", {6e-6, 2e-6, 4, 7e-16}},
        {"neural, view", {2e-3, 2e-3, 5, 6e-16}},
        {"neural, neurons at 0", {2e-7, 2e-7, 2, 3e-16}},
        {"neural, neurons all off or on", {2e-7, 3e-6, 3, 4e-16}},
        {"neural, saturated output", {3e-7, 2e-5, 3, 3e-16}},
        {"neural_1layer, features", {4e-6, 1e-6, 4, 5e-16}},
        {"neural_1layer, shared weights", {7e-6, 4e-4, 9, 8e-16}},
        {"neural_1layer, base colour", {3e-6, 2e-6, 4, 6e-16}},
        {"neural_1layer, view", {2e-3, 2e-3, 7, 7e-16}},
        {"neural_1layer, neurons at 0", {2e-7, 2e-7, 2, 3e-16}},
        {"neural_1layer, neurons all off or on", {2e-7, 9e-7, 3, 6e-16}},
        {"neural_1layer, saturated output", {2e-7, 9e-6, 5, 3e-16}},
        {"neural_3layers, features", {3e-6, 2e-6, 5, 1e-15}},
        {"neural_3layers, shared weights", {2e-5, 7e-5, 9, 2e-7}},
        {"neural_3layers, base colour", {3e-6, 2e-6, 5, 8e-16}},
        {"neural_3layers, view", {2e-3, 2e-3, 5, 8e-16}},
        {"neural_3layers, neurons at 0", {2e-7, 2e-7, 2, 3e-16}},
        {"neural_3layers, neurons all off or on", {2e-7, 2e-5, 3, 5e-16}},
        {"neural_3layers, saturated output", {6e-7, 2e-5, 3, 3e-16}},
        {"neural_wide, features", {4e-5, 2e-6, 4, 7e-16}},
        {"neural_wide, shared weights", {2e-5, 2e-4, 6, 8e-16}},
        {"neural_wide, base colour", {5e-6, 2e-6, 5, 7e-16}},
        {"neural_wide, view", {2e-3, 2e-3, 5, 8e-16}},
        {"neural_wide, neurons at 0", {2e-7, 2e-7, 2, 3e-16}},
        {"neural_wide, neurons all off or on", {2e-7, 2e-5, 5, 3e-16}},
        {"neural_wide, saturated output", {2e-7, 4e-6, 2, 3e-16}},
        {"neural_plain, features", {3e-5, 2e-3, 8, 8e-16}},
        {"neural_plain, shared weights", {7e-6, 2e-4, 8, 6e-16}},
        {"neural_plain, base colour", {2e-5, 3e-6, 6, 6e-16}},
        {"neural_plain, view", {2e-3, 2e-3, 5, 5e-16}},
        {"neural_plain, neurons at 0", {2e-7, 2e-7, 2, 3e-16}},
        {"neural_plain, neurons all off or on", {2e-7, 4e-6, 3, 4e-16}},
        {"neural_plain, saturated output", {2e-7, 6e-6, 2, 5e-16}},
        {"none, base colour", {2e-7, 2e-7, 2, 3e-16}},
        {"sh, coefficients", {2e-4, 2e-6, 7, 7e-16}},
        {"sh, base colour", {2e-5, 9e-7, 5, 6e-16}},
        {"sh, view", {9e-4, 5e-6, 9, 8e-16}},
        {"sv, site", {3e-6, 2e-6, 13, 2e-15}},
        {"sv, temperature", {6e-6, 3e-6, 9, 5e-12}},
        {"sv, colour", {2e-5, 2e-6, 8, 1e-15}},
        {"sv, base colour", {3e-6, 2e-6, 7, 2e-15}},
        {"sv, view", {2e-3, 2e-3, 11, 8e-16}},
        {"sv, view at a site", {3e-7, 3e-6, 3, 4e-16}},
        {"sv, coincident sites", {3e-7, 2e-6, 3, 3e-16}},
        {"sv, opposite sites", {2e-7, 2e-6, 8, 2e-15}},
        {"sv, short and long sites", {2e-3, 2e-3, 4990, 7e-12}},
    };
    const auto found = known.find(row.model + ", " + row.kind);
    return found != known.end() ? found->second : Bounds{4e-3, 4e-3, 64, 1e-14};
}

TEST(Stability, EveryModelStaysWithinItsBounds) {
    const std::vector<StabilityRow> rows = measure_stability();
    for (const StabilityRow& row : rows) {
        SCOPED_TRACE(row.model + ", " + row.kind);
        const Bounds b = bounds(row);
        EXPECT_GT(row.cases, 3);
        EXPECT_LT(row.forward_error, b.forward);
        EXPECT_LT(row.backward_error, b.backward);
        EXPECT_LT(row.ulp, b.ulp);
        EXPECT_LT(row.double_error, b.double_error);
        EXPECT_EQ(row.num_nonfinite, 0);
        EXPECT_EQ(row.num_sign_flips, 0);
        EXPECT_EQ(row.num_wrong_limits, 0);
        EXPECT_FALSE(row.limit.empty() && row.kind.empty());
    }
}

TEST(Stability, TheTableHasALineForEveryRow) {
    StabilityRow row;
    row.model = "sh", row.kind = "coefficients", row.cases = 7, row.ulp = 1.25, row.limit = "N = 0.154";
    const std::string text = markdown_table(stability_table({row, row}));
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);
    EXPECT_NE(text.find("| sh    | coefficients | N = 0.154     |     7 |"), std::string::npos) << text;
}

/// Measures f(x) = 1 - x/(e^x - 1), and its negative as a "gradient", with the given function in float.
StabilityRow measured(float (*in_float)(float), float x) {
    const auto exact = []<class T>(const StabilityInputs<T>& in) {
        const long double v = in.numbers[0], f = 1 - v / std::expm1(v);
        return StabilitySubject::Results{f, -f};
    };
    const auto computed = [in_float](const StabilityInputs<float>& in) {
        const long double f = in_float(in.numbers[0]);
        return StabilitySubject::Results{f, -f};
    };
    StabilityRow row;
    compare_case({computed, exact, exact, {0, 1}, 1, 2}, {{x}, -1}, row);
    return row;
}

TEST(Stability, SeesCancellation) {
    const auto naive = [](float x) { return 1 - x / std::expm1(x); };
    const auto series = [](float x) { return x * (0.5f - x / 12); };
    EXPECT_GT(measured(naive, 1e-4f).ulp, 300);
    EXPECT_GT(measured(naive, 1e-4f).forward_error, 3e-5);
    EXPECT_LT(measured(series, 1e-4f).ulp, 2);
}

TEST(Stability, SeesNonFiniteValuesAndSignFlips) {
    const auto overflowing = [](float x) { return x * 3e38f * 10; };
    const auto flipped = [](float x) { return -x / 2; };
    const auto zero = [](float) { return 0.0f; };
    EXPECT_EQ(measured(overflowing, 1).num_nonfinite, 2);
    EXPECT_EQ(measured(flipped, 1e-3f).num_sign_flips, 1) << "counted for gradients only";
    EXPECT_EQ(measured(zero, 1e-3f).num_sign_flips, 0) << "no gradient is not a wrong one";
}

TEST(Stability, WhatRoundingOfTheInputsExplainsIsNoError) {
    // x - 1 at x = 1 + 2^-20: half an ulp of x is a sixteenth of the result.
    const auto exact = []<class T>(const StabilityInputs<T>& in) {
        return StabilitySubject::Results{(long double)(in.numbers[0]) - 1};
    };
    const auto rounded = [](const StabilityInputs<float>&) { return StabilitySubject::Results{1.05L * 0x1p-20L}; };
    StabilityRow row;
    compare_case({rounded, exact, exact, {0}, 0, 1}, {{1 + 0x1p-20f}, -1}, row);
    EXPECT_LT(row.ulp, 1);
    EXPECT_EQ(row.backward_error, 0) << "not determined to three digits";
}

TrainOptions small_run() {
    TrainOptions o;
    o.source = "builtin:glossy", o.model = "unused", o.device = Device::kCpu, o.resolution = 60, o.eval = true;
    o = resolve(o);
    return o;
}

TEST(Precision, LevelsAreNamedOnceAndDiffer) {
    std::set<std::string> names;
    std::set<std::map<std::string, std::string>> settings;
    for (const PrecisionLevel& level : precision_levels()) {
        TrainOptions o = small_run();
        level.apply(o);
        EXPECT_NO_THROW(resolve(o)) << level.name;
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
    const Scene scene = load_scene(options);
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
    const Scene scene = load_scene(options);
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
