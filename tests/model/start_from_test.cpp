// SPDX-License-Identifier: Apache-2.0
// A trained model as the beginning of another training: places, colours and residuals that stay, and what is refused.
#include "lib/model/initialize.h"

#include <gtest/gtest.h>
#include <cmath>
#include <cstring>
#include <set>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/model_file.h"
#include "lib/model/ply.h"
#include "lib/model/whole_model.h"
#include "tests/io/file_helpers.h"
#include "tests/model/hostile_start.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

using namespace std::string_literals;

/// A scene of one camera, in a frame.
Scene scene_in(const Frame& frame) {
    Scene scene;
    scene.frame = frame;
    scene.train.resize(1);
    scene.train[0].camera.translation = {0.3, -0.2, 9};
    return scene;
}

/// Writes a model and begins with it.
Gaussians begun(const Gaussians& g, const AppearanceSpec& appearance, const Frame& file = {}, const Frame& now = {}) {
    const TempFolder folder;
    write_ply(folder / "p.ply", g, {.frame = file});
    return start_from(read_initial_model(folder / "p.ply"), scene_in(now), appearance, 1);
}

/// Returns the colour of a Gaussian as the camera of scene_in() sees it.
Vec3<double> seen_color(const Gaussians& g, std::int64_t i) {
    const float* base = &g[Group::kBase].param[3 * std::size_t(i)];
    Vec3<double> y{base[0], base[1], base[2]};
    const int width = g[Group::kResidual].width;
    if (i < g.num_residuals()) {
        const Eigen::Vector3d at = Eigen::Vector3f::Map(&g[Group::kMean].param[3 * std::size_t(i)]).cast<double>(),
                              d = (at - scene_in({}).train[0].camera.center()).normalized();
        const float* row = g[Group::kResidual].param.data() + i * width;
        const std::vector<double> params(row, row + width), shared(g.shared.param.begin(), g.shared.param.end());
        y = y + appearance_model(g.appearance.model)
                    .residual(shared.data(), params.data(), {d.x(), d.y(), d.z()}, g.appearance.max_degree);
    }
    return activate(g.appearance.activation, y);
}

/// A PLY holds the base over Y0, which rounds it.
void expect_same_bases(const Gaussians& a, const Gaussians& b) {
    ASSERT_EQ(a[Group::kBase].param.size(), b[Group::kBase].param.size());
    for (std::size_t i = 0; i < a[Group::kBase].param.size(); ++i)
        EXPECT_FLOAT_EQ(a[Group::kBase].param[i], b[Group::kBase].param[i]);
}

class StartFrom : public ::testing::TestWithParam<const ModelInfo*> {
  protected:
    AppearanceSpec spec() const { return {GetParam()->name, GetParam()->default_max_degree, ColorActivation::kRelu}; }
};
INSTANTIATE_TEST_SUITE_P(All, StartFrom, ::testing::ValuesIn(appearance_models()),
                         [](const auto& info) { return info.param->name; });

TEST_P(StartFrom, TheSameModelGoesOn) {
    const Gaussians g = random_gaussians(7, spec()), out = begun(g, spec());
    EXPECT_EQ(out.count, 7);
    EXPECT_EQ(out.active_degree, spec().max_degree);
    expect_same_bases(out, g);
    EXPECT_EQ(out[Group::kResidual].param, g[Group::kResidual].param);
    EXPECT_EQ(out.shared.param, g.shared.param);
    EXPECT_TRUE(out[Group::kMean].m.empty()) << "without moments";
}

TEST_P(StartFrom, AnotherModelBeginsWithTheColoursThatWereSeen) {
    // Colours in the open interval that every activation reaches.
    Gaussians g = random_gaussians(20, {"sh", 2, ColorActivation::kRelu});
    for (float& x : g[Group::kBase].param) x = std::clamp(x, -0.3f, 0.3f);
    for (float& x : g[Group::kResidual].param) x = std::clamp(0.02f * x, -0.02f, 0.02f);
    for (const ColorActivation activation : {ColorActivation::kRelu, ColorActivation::kSigmoid}) {
        AppearanceSpec wanted = spec();
        wanted.activation = activation;
        if (GetParam()->plain_sh && activation == ColorActivation::kRelu) continue;  // below
        const Gaussians out = begun(g, wanted);
        EXPECT_EQ(out.appearance.model, wanted.model);
        EXPECT_EQ(out.num_residuals(), group_width(Group::kResidual, wanted) > 0 ? 20 : 0);
        EXPECT_EQ(int(out.shared.param.size()), GetParam()->num_shared);
        for (std::int64_t i = 0; i < out.count; ++i) {
            const Vec3<double> before = seen_color(g, i), after = seen_color(out, i);
            EXPECT_NEAR(before.x, after.x, 2e-6);
            EXPECT_NEAR(before.y, after.y, 2e-6);
            EXPECT_NEAR(before.z, after.z, 2e-6);
        }
    }
}

TEST(StartFromSh, KeepsTheBandsThatBothHave) {
    const Gaussians g = random_gaussians(5, {"sh", 2, ColorActivation::kRelu});
    const int had = g[Group::kResidual].width;
    for (const int degree : {1, 3}) {
        const Gaussians out = begun(g, {"sh", degree, ColorActivation::kRelu});
        EXPECT_EQ(out.active_degree, degree);
        const int width = out[Group::kResidual].width;
        for (int i = 0; i < 5; ++i)
            for (int k = 0; k < width; ++k)
                EXPECT_EQ(out[Group::kResidual].param[std::size_t(i * width + k)],
                          k < had ? g[Group::kResidual].param[std::size_t(i * had + k)] : 0.0f);
    }
    const Gaussians plain = random_gaussians(5, {"none", 0, ColorActivation::kRelu});
    const Gaussians out = begun(plain, {"sh", 3, ColorActivation::kRelu});
    EXPECT_EQ(out[Group::kResidual].param, std::vector<float>(5 * 45));
    expect_same_bases(out, plain);
}

TEST(StartFromFrame, PlacesAreThoseOfTheScene) {
    const Gaussians g = random_gaussians(9, {"none", 0, ColorActivation::kRelu});
    const Frame file{{1, -2, 3}, 4}, now{{-5, 0.5, 2}, 0.25};
    Gaussians expected = begun(g, g.appearance, file, Frame{});  // scene coordinates
    bring_into_frame(expected, now);
    const Gaussians out = begun(g, g.appearance, file, now);
    for (std::size_t i = 0; i < out[Group::kMean].param.size(); ++i) {
        EXPECT_NEAR(out[Group::kMean].param[i], expected[Group::kMean].param[i], 1e-5);
        EXPECT_NEAR(out[Group::kScale].param[i], expected[Group::kScale].param[i], 1e-5);
    }
}

TEST(StartFromFile, InfiniteParametersBeginAsFiniteOnes) {
    Gaussians g = random_gaussians(3, {"none", 0, ColorActivation::kRelu});
    const float infinity = std::numeric_limits<float>::infinity(), untouched = g[Group::kScale].param[0];
    g[Group::kOpacity].param = {infinity, -infinity, 2};
    g[Group::kScale].param[8] = -infinity;
    const Gaussians out = begun(g, g.appearance);
    EXPECT_GT(sigmoid(double(out[Group::kOpacity].param[0])), 0.999);
    EXPECT_LT(out[Group::kOpacity].param[0], 17) << "there would be no gradient";
    EXPECT_LT(sigmoid(double(out[Group::kOpacity].param[1])), 1.0 / 255);
    EXPECT_EQ(out[Group::kOpacity].param[2], 2);
    EXPECT_EQ(out[Group::kScale].param[0], untouched);
    EXPECT_EQ(out[Group::kScale].param[8], -12);
}

TEST(StartFromFile, WhatCannotBeginIsNamed) {
    const TempFolder folder;
    const AppearanceSpec none{"none", 0, ColorActivation::kRelu};
    EXPECT_THROW(read_initial_model(folder / "p.splat"), UsageError);
    EXPECT_THROW(read_initial_model(folder / "missing.ply"), DataError);
    spit(folder / "p.spz", "NGSP");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_initial_model(folder / "p.spz"); }), "splat-transform");
    spit(folder / "sog" / "meta.json", R"({"means":{},"quats":{}})");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_initial_model(folder / "sog"); }), "splat-transform");
    std::filesystem::create_directory(folder / "run");
    EXPECT_THROW(read_initial_model(folder / "run"), DataError);
    write_ply(folder / "empty.ply", random_gaussians(0, none), {});
    EXPECT_THROW(read_initial_model(folder / "empty.ply"), DataError);
}

// Files of other programs given as a model: what they are called, and the advice.

template <class T> std::string bytes_of(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// Returns a .splat of `count` Gaussians.
std::string splat(int count) {
    std::string bytes;
    for (int i = 0; i < count; ++i)
        bytes += bytes_of<float>({float(i), -2, 3, 0.1f, 0.2f, 0.3f}) + "\x10\x20\x30\xff"s + "\xff\x80\x80\x80"s;
    return bytes;
}

std::string ksplat() {
    std::string bytes(4096 + 1024 + 64, '\0');
    const std::string header = "\x00\x01\x00\x00"s + bytes_of<std::uint32_t>({1, 1, 2, 2, 1});
    return bytes.replace(0, header.size(), header);
}

std::string ply(const std::string& elements) {
    return "ply\nformat binary_little_endian 1.0\n" + elements + "end_header\n" + std::string(256, '\0');
}

const std::string kPoints = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n";

struct Case {
    const char* name;
    std::string bytes;
    std::vector<const char*> said;
};

TEST(ModelFile, FilesOfOtherKindsSayWhatTheyAreAndWhatToDo) {
    const char* convert = "npx @playcanvas/splat-transform ";
    const std::vector<Case> cases = {
        {"a.spz", "\x1f\x8b\x08\x00 gzip", {".spz file", convert, "a.spz ", "a.ply"}},
        {"b.spz", "NGSP\x04\x00\x00\x00", {".spz file", convert}},
        {"a.ply", "\x1f\x8b\x08\x00 gzip", {".spz file", "name it ", "a.spz", convert}},
        {"a.ply.gz", "\x1f\x8b\x08\x00 gzip", {"gunzip"}},
        {"a.sog", "PK\x03\x04 meta.json .. means_l.webp", {".sog file", convert, "a.sog "}},
        {"meta.json", R"({"means":{"files":[]},"quats":{}})", {".sog file", convert, "meta.json ", "scene.ply"}},
        {"a.splat", splat(3), {".splat file", convert}},
        {"splat.ply", splat(90), {".splat file", convert}},
        {"a.ksplat", ksplat(), {".ksplat file", convert}},
        {"k.ply", ksplat(), {".ksplat file", convert}},
        {"c.compressed.ply",
         ply("element chunk 1\nproperty float min_x\nelement vertex 2\nproperty uint packed_position\n"),
         {"compressed .ply", convert, "c.ply"}},
        {"c.ply",
         ply("element chunk 1\nproperty float min_x\nelement vertex 2\nproperty uint packed_position\n"),
         {"compressed .ply", convert, "c-out.ply"}},
        {"points.ply", ply(kPoints + "property uchar red\n"), {"point cloud", "points3D.ply", "-s SCENE"}},
        {"text.ply", "ply\nformat ascii 1.0\n" + kPoints + "end_header\n0 0 0\n1 1 1\n", {"point cloud"}},
        {"mesh.ply", ply(kPoints + "element face 1\nproperty list uchar int vertex_indices\n"), {"mesh"}},
        {"a.glb", "glTF\x02\x00\x00\x00", {"glTF", ".ply"}},
        {"a.gltf", R"({"asset":{"version":"2.0"},"scenes":[],"nodes":[]})", {"glTF"}},
        {"a.pth", "PK\x03\x04 archive/data.pkl", {"PyTorch", "--save_ply", "ns-export"}},
        {"old.pt", "\x80\x02}q\x01", {"PyTorch"}},
        {"a.npz", "PK\x03\x04 means.npy", {"NumPy"}},
        {"a.zip", "PK\x03\x04 photos/1.jpg", {"zip archive", "unpack"}},
        {"a.obj", "# Blender\nmtllib a.mtl\nv 0 0 0\n", {"mesh (.obj)"}},
        {"a.ngsplat", "NGSPLAT\n", {".ngsplat", "gsapp view"}},
        {"a.safetensors", std::string("\x10\0\0\0\0\0\0\0{}", 10), {"checkpoint", "run folder"}},
        {"page.ply", "<!DOCTYPE html><html>", {"web page", "download"}},
        {"lfs.ply",
         "version https://git-lfs.github.com/spec"
         "/v1\n",
         {"git lfs pull"}},
        {"broken.spz", "nothing", {".spz", "damaged"}},
        {"none.ply", "hello\n", {"does not begin with 'ply'"}},
        {"empty.ply", "", {"empty"}},
    };
    const TempFolder folder;
    for (const Case& one : cases) {
        spit(folder / one.name, one.bytes);
        const std::string what = other_model(folder / one.name);
        EXPECT_TRUE(what.starts_with("it is ")) << one.name << ": " << what;
        for (const char* said : one.said) EXPECT_CONTAINS(one.name + ": "s + what, said);
        EXPECT_CONTAINS(message_of<DataError>([&] { read_ply(folder / one.name); }), one.name + "': "s + what);
    }
}

TEST(ModelFile, AFolderOfSogIsNamedAndOthersAreLeftToTheirReaders) {
    const TempFolder folder;
    spit(folder / "sog" / "meta.json", R"({"means":{},"scales":{}})");
    EXPECT_CONTAINS(other_model(folder / "sog"), "meta.json");
    spit(folder / "run" / "config.yaml", "");
    EXPECT_EQ(other_model(folder / "run"), "");
    EXPECT_EQ(other_model(folder / "missing.spz"), "");
    write_ply(folder / "good.ply", random_gaussians(2, {"sh", 1, ColorActivation::kRelu}), {});
    EXPECT_EQ(other_model(folder / "good.ply"), "");
}

// Which Gaussians a hostile start changes, and how.

Gaussians ordinary(std::int64_t count) {
    Gaussians g;
    g.count = count;
    g.appearance = {"nasg", 1, ColorActivation::kRelu};
    const int widths[kNumGroups] = {3, 3, 4, 1, 3, 8};
    for (int k = 0; k < kNumGroups; ++k)
        g.groups[k].width = widths[k], g.groups[k].param.assign(std::size_t(count) * widths[k], 0.25f);
    return g;
}

bool changed(const Gaussians& g, Group group, std::int64_t i) {
    const auto& values = g[group];
    bool all = true, none = true;
    for (int k = 0; k < values.width; ++k)
        (values.param[std::size_t(i) * values.width + k] == 0.25f ? all : none) = false;
    EXPECT_NE(all, none) << "the whole row or nothing of it";
    return all;
}

TEST(HostileStart, ChangesItsShareAndAllButTheMean) {
    Gaussians g = ordinary(4000);
    const std::int64_t count = make_hostile(g, 0.1, 3);
    EXPECT_NEAR(double(count), 400, 80) << "four standard deviations";
    std::int64_t found = 0;
    for (std::int64_t i = 0; i < g.count; ++i) {
        EXPECT_FALSE(changed(g, Group::kMean, i));
        const bool base = changed(g, Group::kBase, i);
        for (const Group group : {Group::kScale, Group::kRotation, Group::kOpacity, Group::kResidual})
            EXPECT_EQ(changed(g, group, i), base) << i;
        found += base;
    }
    EXPECT_EQ(found, count);
}

TEST(HostileStart, DrawsEveryExtremeAndNothingElse) {
    Gaussians g = ordinary(500);
    EXPECT_EQ(make_hostile(g, 1, 0), 500);
    const auto magnitudes = [&](Group group) {
        std::set<float> found;
        for (const float x : g[group].param) found.insert(std::abs(x));
        return found;
    };
    EXPECT_EQ(magnitudes(Group::kScale), (std::set<float>{2, 30}));
    EXPECT_EQ(magnitudes(Group::kRotation), (std::set<float>{1e-20f, 1e-3f, 1e3f, 1e20f}));
    EXPECT_EQ(magnitudes(Group::kOpacity), (std::set<float>{50}));
    EXPECT_EQ(magnitudes(Group::kBase), (std::set<float>{3, 1e4f}));
    EXPECT_EQ(magnitudes(Group::kResidual), (std::set<float>{1e-6f, 1e4f, 1e30f}));
}

TEST(HostileStart, DependsOnTheSeedAndTheRowAlone) {
    Gaussians a = ordinary(100), b = ordinary(300), c = ordinary(100), none = ordinary(100);
    make_hostile(a, 0.5, 1), make_hostile(b, 0.5, 1), make_hostile(c, 0.5, 2);
    EXPECT_EQ(make_hostile(none, 0, 1), 0);
    b[Group::kScale].param.resize(a[Group::kScale].param.size());
    EXPECT_EQ(a[Group::kScale].param, b[Group::kScale].param);
    EXPECT_NE(a[Group::kScale].param, c[Group::kScale].param);
    EXPECT_EQ(none[Group::kScale].param, ordinary(100)[Group::kScale].param);
}

}  // namespace
}  // namespace gs::test
