// SPDX-License-Identifier: Apache-2.0
// Checkpoints come back bit for bit, and wrong ones are refused by name.
#include "lib/model/checkpoint.h"

#include <cmath>
#include <cstring>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

Checkpoint sample(bool with_moments) {
    Checkpoint c;
    c.state = random_gaussians(7, {"sh", 2, ColorActivation::kSoftplus}, with_moments);
    c.state.active_degree = 1;
    c.state.step = 1234;
    c.iteration = 1300;
    c.seed = 0xfedcba9876543210u;
    c.options_yaml = "source: \"a b\"\niterations: 30000\n";
    c.test_views = "8 0123456789abcdef";
    c.frame = {{5e5, 4e6, 0.1}, 1 / 3.0};
    if (with_moments) c.state.last_step = {0, 1234, 3, 1000, 5, 6, 7};
    return c;
}

TEST(Checkpoint, RoundTripsBitForBit) {
    const TempFolder folder;
    for (const bool with_moments : {true, false}) {
        const Checkpoint c = sample(with_moments);
        write_checkpoint(folder / "c.safetensors", c);
        const Checkpoint back = read_checkpoint(folder / "c.safetensors");
        EXPECT_EQ(back.iteration, c.iteration);
        EXPECT_EQ(back.seed, c.seed);
        EXPECT_EQ(back.options_yaml, c.options_yaml);
        EXPECT_EQ(back.test_views, c.test_views);
        EXPECT_EQ(back.frame.center, c.frame.center);
        EXPECT_EQ(back.frame.scale, c.frame.scale);
        EXPECT_EQ(read_checkpoint_frame(folder / "c.safetensors").scale, c.frame.scale);
        EXPECT_EQ(back.state.count, c.state.count);
        EXPECT_EQ(back.state.step, c.state.step);
        EXPECT_EQ(back.state.active_degree, 1);
        EXPECT_EQ(describe(back.state.appearance), "sh, max degree 2, softplus");
        for (int i = 0; i < kNumGroups; ++i) {
            EXPECT_EQ(back.state.groups[i].width, c.state.groups[i].width);
            EXPECT_EQ(back.state.groups[i].param, c.state.groups[i].param);
            EXPECT_EQ(back.state.groups[i].m, c.state.groups[i].m);
            EXPECT_EQ(back.state.groups[i].v, c.state.groups[i].v);
            EXPECT_EQ(back.state.groups[i].m.empty(), !with_moments || c.state.groups[i].width == 0);
        }
        EXPECT_EQ(back.state.last_step, c.state.last_step);
    }
}

TEST(Checkpoint, KeepsTheFilterOfAnAntialiasedModel) {
    const TempFolder folder;
    for (const bool with_moments : {true, false}) {
        Checkpoint c = sample(with_moments);
        c.state.antialiased = true;
        c.state[Group::kSmoothing] = {1, {0, 1e-4f, 2, 3, 4, 5, 6}, {}, {}};
        write_checkpoint(folder / "c.safetensors", c);
        const Gaussians back = read_checkpoint(folder / "c.safetensors").state;
        EXPECT_TRUE(back.antialiased);
        EXPECT_EQ(back[Group::kSmoothing].width, 1);
        EXPECT_EQ(back[Group::kSmoothing].param, c.state[Group::kSmoothing].param);
        c.state[Group::kSmoothing].param[3] = -1;
        write_checkpoint(folder / "c.safetensors", c);
        EXPECT_CONTAINS(message_of<DataError>([&] { read_checkpoint(folder / "c.safetensors"); }),
                        "tensor 'smoothing' holds -1 in row 3");
    }
}

TEST(Checkpoint, TimeRoundTripsAndMayBeMissing) {
    const TempFolder folder;
    Checkpoint c = sample(true);
    write_checkpoint(folder / "c.safetensors", c);
    EXPECT_FALSE(read_checkpoint(folder / "c.safetensors").time);
    EXPECT_FALSE(is_automatic_checkpoint(folder / "c.safetensors"));
    c.time = {123.4, 0.1}, c.automatic = true;
    write_checkpoint(folder / "c.safetensors", c);
    const Checkpoint read = read_checkpoint(folder / "c.safetensors");
    EXPECT_EQ(read.time->train_seconds, 123.4);
    EXPECT_EQ(read.time->data_wait_seconds, 0.1);
    EXPECT_TRUE(read.automatic);
    EXPECT_TRUE(is_automatic_checkpoint(folder / "c.safetensors"));
    EXPECT_FALSE(is_automatic_checkpoint(folder / "missing.safetensors"));
    for (const std::string bad : {"-23.4", "1e999", "later"}) {
        std::string bytes = slurp(folder / "c.safetensors");
        bytes.replace(bytes.find("123.4"), 5, bad);
        spit(folder / "bad.safetensors", bytes);
        EXPECT_CONTAINS(message_of<DataError>([&] { read_checkpoint(folder / "bad.safetensors"); }),
                        "metadata 'train_seconds' is '" + bad + "'");
    }
}

TEST(Checkpoint, ModelWithoutResidualRoundTrips) {
    const TempFolder folder;
    Checkpoint c;
    c.state = random_gaussians(3, {"none", 0, ColorActivation::kRelu}, true);
    write_checkpoint(folder / "c.safetensors", c);
    const Checkpoint back = read_checkpoint(folder / "c.safetensors");
    EXPECT_EQ(back.state[Group::kResidual].width, 0);
    EXPECT_EQ(back.state[Group::kBase].v, c.state[Group::kBase].v);
}

TEST(Checkpoint, ResidualsOfTheFirstGaussiansRoundTrip) {
    const TempFolder folder;
    for (const std::size_t with : {std::size_t(0), std::size_t(1)}) {
        Checkpoint c = sample(true);
        auto& residuals = c.state[Group::kResidual];
        for (auto* data : {&residuals.param, &residuals.m, &residuals.v})
            data->resize(with * std::size_t(residuals.width));
        write_checkpoint(folder / "c.safetensors", c);
        const Gaussians back = read_checkpoint(folder / "c.safetensors").state;
        EXPECT_EQ(back.num_residuals(), std::int64_t(with));
        EXPECT_TRUE(back.is_mixed());
        EXPECT_EQ(back[Group::kResidual].param, residuals.param);
        EXPECT_EQ(back[Group::kResidual].m, residuals.m);
        EXPECT_EQ(back[Group::kResidual].v, residuals.v);
    }
}

TEST(Checkpoint, NonFiniteValueIsNamedByTensorAndRow) {
    const TempFolder folder;
    Checkpoint c = sample(true);
    c.state[Group::kResidual].param[24 * 4 + 3] = std::nanf("");
    write_checkpoint(folder / "c.safetensors", c);
    const std::string message = message_of<DataError>([&] { read_checkpoint(folder / "c.safetensors"); });
    EXPECT_CONTAINS(message, "c.safetensors");
    EXPECT_CONTAINS(message, "'residuals' holds nan in row 4");
    c = sample(true);
    c.state[Group::kScale].v[3 * 6 + 2] = INFINITY;
    write_checkpoint(folder / "c.safetensors", c);
    EXPECT_CONTAINS(message_of<DataError>([&] { read_checkpoint(folder / "c.safetensors"); }),
                    "'adam_v.raw_scales' holds inf in row 6");
}

TEST(Checkpoint, WrongContentIsNamed) {
    const TempFolder folder;
    write_checkpoint(folder / "c.safetensors", sample(true));
    const std::string good = slurp(folder / "c.safetensors");
    // Replacements keep the length, so that the header stays in step with its length field.
    const auto error = [&](const std::string& from, const std::string& to) {
        std::string bytes = good;
        EXPECT_EQ(from.size(), to.size());
        EXPECT_NE(bytes.find(from), std::string::npos) << from;
        spit(folder / "bad.safetensors", bytes.replace(bytes.find(from), from.size(), to));
        return message_of<DataError>([&] { read_checkpoint(folder / "bad.safetensors"); });
    };
    EXPECT_CONTAINS(error("gsapp-checkpoint-1", "gsapp-checkpoint-9"), "expected 'gsapp-checkpoint-1'");
    EXPECT_CONTAINS(error("\"iteration\":\"1300\"", "\"iteration\":\"-300\""), "'iteration' is '-300'");
    EXPECT_CONTAINS(error("\"adam_step\":\"1234\"", "\"adam_step\":\"12x4\""), "'adam_step' is '12x4'");
    EXPECT_CONTAINS(error("\"active_degree\":\"1\"", "\"active_degree\":\"3\""), "active_degree 3");
    EXPECT_CONTAINS(error("\"max_degree\":\"2\"", "\"max_degree\":\"7\""), "max_degree 7");
    EXPECT_CONTAINS(error("\"max_degree\":\"2\"", "\"max_degree\":\"1\""), "'residuals'");
    EXPECT_CONTAINS(error("\"appearance\":\"sh\"", "\"appearance\":\"qq\""), "'qq'");
    EXPECT_CONTAINS(error("\"softplus\"", "\"softplum\""), "softplum");
    EXPECT_CONTAINS(error("\"seed\"", "\"sead\""), "'seed' is missing");
    EXPECT_CONTAINS(error("\"rotations\"", "\"rotatxons\""), "'rotations' is missing");
    EXPECT_CONTAINS(error("\"adam_v.means\"", "\"adam_w.means\""), "'adam_v.means' is missing");
    EXPECT_CONTAINS(error("\"adam_step\":\"1234\"", "\"adam_step\":\"1233\""),
                    "tensor 'last_step' holds 1234, expected 0..1233");
    EXPECT_CONTAINS(error("[7,4]", "[4,7]"), "'rotations' does not have the shape (7, 4)");
    spit(folder / "bad.safetensors", good.substr(0, good.size() - 4));
    EXPECT_CONTAINS(message_of<DataError>([&] { read_checkpoint(folder / "bad.safetensors"); }), "truncated");
}

/// Returns a checkpoint with PPISP of 3 frames and 2 cameras.
Checkpoint corrected(bool with_moments, bool with_controller) {
    Checkpoint c = sample(with_moments);
    PpispState& p = c.state.ppisp = identity_ppisp(3, 2);
    p.step = 777;
    if (with_controller) initialize_controller(p, 5), p.controller_step = 88;
    const auto fill = [](std::vector<float>& values, std::size_t n) {
        values.resize(n);
        for (std::size_t i = 0; i < n; ++i) values[i] = 0.5f + float(i % 1000);
    };
    fill(p.param, p.size());
    if (with_moments)
        fill(p.m, p.size()), fill(p.v, p.size()), fill(p.controller_m, p.controller.size()),
            fill(p.controller_v, p.controller.size());
    return c;
}

TEST(Checkpoint, PpispRoundTripsBitForBit) {
    const TempFolder folder;
    for (const bool with_moments : {true, false}) {
        for (const bool with_controller : {true, false}) {
            const Checkpoint c = corrected(with_moments, with_controller);
            write_checkpoint(folder / "c.safetensors", c);
            const PpispState p = read_checkpoint(folder / "c.safetensors").state.ppisp, &want = c.state.ppisp;
            EXPECT_EQ(p.num_frames, 3);
            EXPECT_EQ(p.num_cameras, 2);
            EXPECT_EQ(p.step, 777);
            EXPECT_EQ(p.controller_step, want.controller_step);
            EXPECT_EQ(p.param, want.param);
            EXPECT_EQ(p.m, want.m);
            EXPECT_EQ(p.v, want.v);
            EXPECT_EQ(p.controller, want.controller);
            EXPECT_EQ(p.controller_m, want.controller_m);
            EXPECT_EQ(p.controller_v, want.controller_v);
        }
    }
}

TEST(Checkpoint, WithoutPpispHoldsNothingOfIt) {
    const TempFolder folder;
    write_checkpoint(folder / "c.safetensors", sample(true));
    EXPECT_FALSE(read_checkpoint(folder / "c.safetensors").state.ppisp.active());
    EXPECT_EQ(slurp(folder / "c.safetensors").find("ppisp"), std::string::npos);
}

TEST(Checkpoint, WrongPpispIsNamed) {
    const TempFolder folder;
    const auto error_of = [&](const Checkpoint& c, const std::string& from = "", const std::string& to = "") {
        write_checkpoint(folder / "c.safetensors", c);
        std::string bytes = slurp(folder / "c.safetensors");
        EXPECT_EQ(from.size(), to.size());
        EXPECT_NE(bytes.find(from), std::string::npos) << from;
        spit(folder / "bad.safetensors", bytes.replace(bytes.find(from), from.size(), to));
        return message_of<DataError>([&] { read_checkpoint(folder / "bad.safetensors"); });
    };
    const Checkpoint good = corrected(true, true);
    EXPECT_CONTAINS(error_of(good, "\"ppisp_frames\":\"3\"", "\"ppisp_frames\":\"4\""),
                    "tensor 'ppisp' does not have the shape (1, 90)");
    EXPECT_CONTAINS(error_of(good, "\"ppisp_cameras\":\"2\"", "\"ppisp_cameras\":\"1\""),
                    "tensor 'ppisp' does not have the shape (1, 54)");
    EXPECT_CONTAINS(error_of(good, "\"ppisp_cameras\":\"2\"", "\"ppisp_cameras\":\"0\""), "has no cameras");
    EXPECT_CONTAINS(error_of(good, "\"ppisp_step\":\"777\"", "\"ppisp_step\":\"-77\""), "'ppisp_step' is '-77'");
    EXPECT_CONTAINS(error_of(good, "\"adam_v.ppisp\"", "\"adam_w.ppisp\""), "'adam_v.ppisp' is missing");
    Checkpoint bad = good;
    bad.state.ppisp.param[5] = INFINITY;
    EXPECT_CONTAINS(error_of(bad), "'ppisp' holds inf");
    bad = good;
    bad.state.ppisp.controller_v[7] = std::nanf("");
    EXPECT_CONTAINS(error_of(bad), "'adam_v.controller' holds nan");
    bad = good;
    bad.state.ppisp.controller.resize(kControllerWeights);  // of one camera only
    EXPECT_CONTAINS(error_of(bad), "tensor 'controller' does not have the shape (1, 483922)");
    write_checkpoint(folder / "c.safetensors", good);
    const std::string bytes = slurp(folder / "c.safetensors");
    spit(folder / "bad.safetensors", bytes.substr(0, bytes.size() - 4));
    EXPECT_CONTAINS(message_of<DataError>([&] { read_checkpoint(folder / "bad.safetensors"); }), "truncated");
}

TEST(Checkpoint, AnotherAppearanceIsAUsageError) {
    const AppearanceSpec sh3{"sh", 3, ColorActivation::kRelu};
    EXPECT_NO_THROW(require_same_appearance(sh3, sh3, "f"));
    for (const AppearanceSpec& other :
         {AppearanceSpec{"none", 3, ColorActivation::kRelu}, AppearanceSpec{"sh", 2, ColorActivation::kRelu},
          AppearanceSpec{"sh", 3, ColorActivation::kSigmoid}}) {
        const std::string message =
            message_of<UsageError>([&] { require_same_appearance(sh3, other, "c.safetensors"); });
        EXPECT_CONTAINS(message, "c.safetensors");
        EXPECT_CONTAINS(message, "(sh, max degree 3, relu)");
        EXPECT_CONTAINS(message, "(" + describe(other) + ")");
    }
}

}  // namespace
}  // namespace gs::test
