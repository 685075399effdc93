// SPDX-License-Identifier: Apache-2.0
// Every registered model through the files: PLY and checkpoint. Knows no model by name, so that it runs on any
// registry.
#include <cmath>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

/// `back` equals `g` as far as a PLY can hold it: unit rotations, base colours to one rounding of f_dc.
void expect_same_model(const Gaussians& back, const Gaussians& g) {
    ASSERT_EQ(back.count, g.count);
    EXPECT_EQ(describe(back.appearance), describe(g.appearance));
    EXPECT_EQ(back.active_degree, g.active_degree);
    const bool relu = g.appearance.activation == ColorActivation::kRelu;
    for (int group = 0; group < kNumGroups; ++group) {
        const auto &a = back.groups[group].param, &b = g.groups[group].param;
        EXPECT_EQ(back.groups[group].width, g.groups[group].width);
        ASSERT_EQ(a.size(), b.size()) << kGroupNames[group];
        EXPECT_TRUE(back.groups[group].m.empty());
        if (Group(group) == Group::kRotation) {
            for (std::size_t i = 0; i < a.size(); i += 4) {
                double dot = 0, norm2 = 0;
                for (int k = 0; k < 4; ++k) dot += double(a[i + k]) * b[i + k], norm2 += double(b[i + k]) * b[i + k];
                EXPECT_NEAR(dot, std::sqrt(norm2), 1e-6 * std::sqrt(norm2));
            }
        } else if (Group(group) == Group::kBase && relu) {
            for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1.2e-7 * std::abs(b[i]));
        } else {
            EXPECT_EQ(a, b) << kGroupNames[group];
        }
    }
    EXPECT_EQ(back.shared.param, g.shared.param);
}

/// Calls `check` with every model, degree and activation.
template <class Check> void for_every_appearance(Check&& check) {
    for (const ModelInfo* model : appearance_models()) {
        for (int degree = 0; degree <= model->max_degree_limit; ++degree) {
            for (int activation = 0; activation < 4; ++activation) {
                const AppearanceSpec appearance{model->name, degree, ColorActivation(activation)};
                SCOPED_TRACE(describe(appearance));
                check(appearance);
            }
        }
    }
}

TEST(EveryModelInFiles, PlyRoundTripsAllColumns) {
    const TempFolder folder;
    for_every_appearance([&](const AppearanceSpec& appearance) {
        Gaussians g = random_gaussians(9, appearance);
        g.active_degree = appearance.max_degree / 2;
        write_ply(folder / "p.ply", g, {});
        expect_same_model(read_ply(folder / "p.ply"), g);
    });
}

TEST(EveryModelInFiles, SharedWeightsOfAPlyAreChecked) {
    const TempFolder folder;
    for (const ModelInfo* model : appearance_models()) {
        if (model->num_shared == 0) continue;
        SCOPED_TRACE(model->name);
        Gaussians g = random_gaussians(3, {model->name, model->default_max_degree, ColorActivation::kRelu});
        write_ply(folder / "good.ply", g, {});
        const std::string bytes = slurp(folder / "good.ply");
        const auto expect_refused = [&](const std::string& changed, const std::string& word) {
            spit(folder / "bad.ply", changed);
            const std::string message = message_of<DataError>([&] { read_ply(folder / "bad.ply"); });
            EXPECT_CONTAINS(message, "bad.ply");
            EXPECT_CONTAINS(message, word);
        };
        expect_refused(bytes.substr(0, bytes.size() - 4), "truncated");
        const std::string nan("\x00\x00\xc0\x7f", 4), large("\x00\x00\x00\x60", 4);
        expect_refused(bytes.substr(0, bytes.size() - 4) + nan, "shared weight");
        expect_refused(bytes.substr(0, bytes.size() - 4) + large, "shared weight");
        std::string none = bytes;
        none.replace(none.find("element shared"), 14, "element others");
        expect_refused(none, "0 shared weights");
        g.shared.param[1] = INFINITY;
        EXPECT_THROW(write_ply(folder / "inf.ply", g, {}), NumericError);
        EXPECT_FALSE(std::filesystem::exists(folder / "inf.ply"));
    }
}

TEST(EveryModelInFiles, CheckpointRoundTripsBitForBit) {
    const TempFolder folder;
    for_every_appearance([&](const AppearanceSpec& appearance) {
        Checkpoint c;
        c.state = random_gaussians(9, appearance, true);
        c.state.active_degree = appearance.max_degree / 2;
        write_checkpoint(folder / "c.safetensors", c);
        const Gaussians back = read_checkpoint(folder / "c.safetensors").state;
        EXPECT_EQ(describe(back.appearance), describe(appearance));
        EXPECT_EQ(back.active_degree, c.state.active_degree);
        for (int k = 0; k < kNumGroups; ++k) {
            EXPECT_EQ(back.groups[k].width, c.state.groups[k].width) << kGroupNames[k];
            EXPECT_EQ(back.groups[k].param, c.state.groups[k].param) << kGroupNames[k];
            EXPECT_EQ(back.groups[k].m, c.state.groups[k].m) << kGroupNames[k];
            EXPECT_EQ(back.groups[k].v, c.state.groups[k].v) << kGroupNames[k];
        }
        EXPECT_EQ(back.shared.param, c.state.shared.param);
        EXPECT_EQ(back.shared.m, c.state.shared.m);
        EXPECT_EQ(back.shared.v, c.state.shared.v);
    });
}

}  // namespace
}  // namespace gs::test
