// SPDX-License-Identifier: Apache-2.0
// The container: offsets by hand, the way there and back, and files that are damaged.
#include "lib/export/ngsplat.h"

#include <algorithm>
#include <cstring>
#include <numeric>

#include "kernels/base/error.h"
#include "lib/export/file_rows.h"
#include "lib/export/pack_scene.h"
#include "lib/export/packed_model.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

PackedScene packed(const std::string& model, std::int64_t count, bool extras = false) {
    PackedScene scene = pack_gaussians(
        random_gaussians(count, {model, appearance_model(model).default_max_degree, ColorActivation::kRelu}));
    scene.center = {1, 2, 3}, scene.distance = 4;
    if (!extras) return scene;
    scene.antialiased = true;
    PackedCamera camera{};
    for (int k = 0; k < 12; ++k) camera.world_from_camera[k] = float(k);
    camera.fx = 100, camera.width = 640;
    scene.cameras = {camera, camera};
    scene.ppisp = PackedPpisp{};
    scene.ppisp->response[17] = 17, scene.ppisp->standard[0] = 0.5f;
    scene.ppisp->views = {PackedFrame{1}, PackedFrame{2}};
    scene.trailer = R"({"appearance":"x"})";
    return scene;
}

template <class T> T value_at(const std::string& bytes, std::size_t offset) {
    T x;
    std::memcpy(&x, bytes.data() + offset, sizeof x);
    return x;
}

TEST(Ngsplat, OffsetsAreThoseOfTheFormat) {
    const TempFolder folder;
    write_ngsplat(folder / "s.ngsplat", packed("nasg", 3));
    const std::string bytes = slurp(folder / "s.ngsplat");
    // Header 96; two textures of halves and the geometry, 16 bytes each for 2048 Gaussians.
    EXPECT_EQ(bytes.size(), 96u + 3 * 16 * 2048);
    EXPECT_EQ(bytes.substr(0, 8), "NGSPLAT\n");
    const std::uint32_t expected[] = {3, 2048, 1, 1, 0, 0, 0, 0, 0, 0, 3 << 3};
    for (std::size_t k = 0; k < std::size(expected); ++k)
        EXPECT_EQ(value_at<std::uint32_t>(bytes, 8 + 4 * k), expected[k]) << k;
    EXPECT_EQ(value_at<float>(bytes, 60), 1);           // camCenter
    EXPECT_EQ(value_at<float>(bytes, 76), -1);          // camUp
    EXPECT_EQ(value_at<float>(bytes, 84), 4);           // camDistance
    EXPECT_EQ(value_at<std::uint32_t>(bytes, 88), 0u);  // nTestCameras
    EXPECT_EQ(value_at<std::uint32_t>(bytes, 92), 0u);  // nWeightTexels
    EXPECT_EQ(bytes.substr(96 + 3 * 16, 2045 * 16), std::string(2045 * 16, '\0')) << "padding";
    // SH adds three scales, PPISP with two cameras 2*72 + 4*(18 + 9 + 2*9), the trailer 8 + 4 + 4 + text + 4.
    write_ngsplat(folder / "t.ngsplat", packed("sh", 2049, true));
    EXPECT_EQ(slurp(folder / "t.ngsplat").size(), 108u + 144 + 180 + (16 + 8 + 16 + 16) * 4096 + 20 + 18);
    // 140 texels of weights; NASGabor's number needs the later bit.
    write_ngsplat(folder / "n.ngsplat", packed("neural", 1));
    EXPECT_EQ(slurp(folder / "n.ngsplat").size(), 96u + 140 * 8 + 3 * 16 * 2048);
    write_ngsplat(folder / "g.ngsplat", packed("nasgabor", 1));
    EXPECT_EQ(value_at<std::uint32_t>(slurp(folder / "g.ngsplat"), 48), 1u << 6);
}

/// Computes CRC-32 bit by bit, as its polynomial is defined.
std::uint32_t plain_crc(const std::string& bytes) {
    std::uint32_t crc = 0xffffffff;
    for (const char c : bytes) {
        crc ^= std::uint8_t(c);
        for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return ~crc;
}

TEST(Ngsplat, ChecksumIsOverAllBytesBeforeIt) {
    const TempFolder folder;
    for (const char* model : {"none", "neural"}) {
        for (const std::int64_t count : {0, 5, 2048}) {  // empty textures, empty padding
            PackedScene scene = packed(model, count);
            scene.trailer = "{}";
            write_ngsplat(folder / "s.ngsplat", scene);
            const std::string bytes = slurp(folder / "s.ngsplat");
            EXPECT_EQ(value_at<std::uint32_t>(bytes, bytes.size() - 4), plain_crc(bytes.substr(0, bytes.size() - 4)))
                << model << " " << count;
        }
    }
}

TEST(Ngsplat, BytesPerGaussianAreThePapers) {
    const std::pair<const char*, int> expected[] = {{"none", 16},     {"sh", 56},     {"sv", 128},        {"nasg", 48},
                                                    {"nasgabor", 48}, {"neural", 48}, {"neural_wide", 48}};
    for (const auto& [model, bytes] : expected) {
        if (has_model(model)) {
            EXPECT_EQ(packed(model, 1).bytes_per_gaussian(), bytes) << model;
        }
    }
}

TEST(Ngsplat, ComesBackExactly) {
    const TempFolder folder;
    for (const ModelInfo* model : appearance_models()) {
        for (const std::int64_t count : {0, 1, 2048, 2049}) {
            for (const bool extras : {false, true}) {
                SCOPED_TRACE(model->name);
                const PackedScene scene = packed(model->name, count, extras);
                write_ngsplat(folder / "s.ngsplat", scene);
                const PackedScene back = read_ngsplat(folder / "s.ngsplat");
                EXPECT_EQ(back.geometry, scene.geometry);
                EXPECT_EQ(back.appearance.textures, scene.appearance.textures);
                EXPECT_EQ(back.appearance.weights, scene.appearance.weights);
                EXPECT_EQ(back.appearance.header.floats, scene.appearance.header.floats);
                EXPECT_EQ(back.cameras.size(), scene.cameras.size());
                EXPECT_EQ(back.trailer, scene.trailer);
                EXPECT_EQ(back.antialiased, extras);
                ASSERT_EQ(back.ppisp.has_value(), extras);
                if (extras) {
                    EXPECT_EQ(back.ppisp->views, scene.ppisp->views);
                }
                write_ngsplat(folder / "t.ngsplat", back);
                EXPECT_EQ(slurp(folder / "t.ngsplat"), slurp(folder / "s.ngsplat"));
            }
        }
    }
}

/// Returns a scene of which the first `with` Gaussians have a residual.
PackedScene mixed(const std::string& model, std::int64_t count, std::int64_t with) {
    Gaussians g = random_gaussians(count, {model, appearance_model(model).default_max_degree, ColorActivation::kRelu});
    g.active_degree = g.appearance.max_degree;
    g[Group::kResidual].param.resize(std::size_t(with * g[Group::kResidual].width));
    return pack_gaussians(g);
}

TEST(Ngsplat, ClassesHaveBothKindsOfGaussians) {
    using Rows = std::vector<std::int64_t>;
    EXPECT_EQ(interleaved_rows(0, 3), (Rows{0, 1, 2}));
    EXPECT_EQ(interleaved_rows(3, 3), (Rows{0, 1, 2}));
    Rows rows = interleaved_rows(32, 96);  // classes of 2 and 4
    EXPECT_EQ(Rows(rows.begin(), rows.begin() + 12), (Rows{0, 1, 32, 33, 34, 35, 2, 3, 36, 37, 38, 39}));
    for (const auto& [with, count] : {std::pair{7, 10}, {1, 1000}, {999, 1000}, {12345, 99999}}) {
        rows = interleaved_rows(with, count);
        std::sort(rows.begin(), rows.end());
        Rows all(static_cast<std::size_t>(count));
        std::iota(all.begin(), all.end(), 0);
        EXPECT_EQ(rows, all) << with << " of " << count;
    }
}

TEST(Ngsplat, OnlyTheFirstGaussiansMayHaveAResidual) {
    const TempFolder folder;
    for (const char* model : {"sh", "sv", "nasg", "neural"}) {
        if (!has_model(model)) continue;
        for (const auto& [count, with] : {std::pair{5, 0}, {5, 2}, {5000, 2049}}) {
            SCOPED_TRACE(model);
            const PackedScene scene = mixed(model, count, with);
            EXPECT_EQ(scene.appearance.rows, with);
            write_ngsplat(folder / "s.ngsplat", scene);
            EXPECT_EQ(std::int64_t(std::filesystem::file_size(folder / "s.ngsplat")), ngsplat_bytes(scene, count, 0));
            EXPECT_EQ(value_at<std::uint32_t>(slurp(folder / "s.ngsplat"), 48) >> 8, 3u);
            EXPECT_EQ(value_at<std::uint32_t>(slurp(folder / "s.ngsplat"), 52), std::uint32_t(with));
            const PackedScene back = read_ngsplat(folder / "s.ngsplat");
            EXPECT_EQ(back.appearance.rows, with);
            EXPECT_EQ(back.appearance.textures, scene.appearance.textures);
            EXPECT_EQ(back.geometry, scene.geometry);
            for (const std::int64_t row : {0, 1, 3, 4}) {
                const Vec3<double> a = packed_color(back, row, {0.6, 0, 0.8}),
                                   b = packed_color(scene, row, {0.6, 0, 0.8});
                EXPECT_EQ(a.x, b.x);
                EXPECT_EQ(a.z, b.z);
            }
        }
        const PackedScene all = mixed(model, 3000, 3000), some = mixed(model, 3000, 1000);
        EXPECT_FALSE(all.is_mixed());
        EXPECT_LT(ngsplat_bytes(some, 3000, 0), ngsplat_bytes(all, 3000, 0));
        EXPECT_NEAR(some.mean_bytes_per_gaussian(), 16 + (all.bytes_per_gaussian() - 16) / 3.0, 1e-9);
    }
    // Without the second flag, as earlier versions wrote it, the file's order is that of the rows.
    std::string bytes = slurp(folder / "s.ngsplat");
    const PackedScene scene = read_ngsplat(folder / "s.ngsplat");
    const std::uint32_t flags = value_at<std::uint32_t>(bytes, 48) & ~512u;
    std::memcpy(bytes.data() + 48, &flags, 4);
    spit(folder / "old.ngsplat", bytes);
    const PackedScene old = read_ngsplat(folder / "old.ngsplat");
    const std::vector<std::int64_t> rows = interleaved_rows(scene.appearance.rows, scene.count());
    for (std::size_t i = 0; i < rows.size(); ++i) ASSERT_EQ(old.geometry[i], scene.geometry[std::size_t(rows[i])]) << i;

    const std::uint32_t wrong = 5000;
    std::memcpy(bytes.data() + 52, &wrong, 4);
    spit(folder / "bad.ngsplat", bytes);
    EXPECT_CONTAINS(message_of<DataError>([&] { read_ngsplat(folder / "bad.ngsplat"); }), "nResiduals is 5000");
}

TEST(Ngsplat, DamagedFilesAreRefused) {
    const TempFolder folder;
    write_ngsplat(folder / "s.ngsplat", packed("neural", 5, true));
    const std::string good = slurp(folder / "s.ngsplat");
    const auto refused = [&](const std::string& bytes, const std::string& word) {
        spit(folder / "bad.ngsplat", bytes);
        const std::string message = message_of<DataError>([&] { read_ngsplat(folder / "bad.ngsplat"); });
        EXPECT_CONTAINS(message, "bad.ngsplat");
        EXPECT_CONTAINS(message, word);
    };
    const auto changed = [&](std::size_t offset, std::uint32_t value) {
        std::string bytes = good;
        std::memcpy(bytes.data() + offset, &value, 4);
        return bytes;
    };
    const std::size_t trailer = good.size() - 20 - 18;
    for (std::size_t size = 0; size < 700; size += 13) refused(good.substr(0, size), "");
    for (const std::size_t size : {trailer - 1, trailer + 3, trailer + 12, trailer + 20, good.size() - 1})
        refused(good.substr(0, size), "");
    refused("", "too few");
    refused(good.substr(0, trailer - 1), "truncated");
    refused("X" + good.substr(1), "NGSPLAT");
    refused(good + "x", "1 bytes follow the trailer");
    refused(good.substr(0, trailer) + "more than the format has", "24 unknown bytes");
    refused(changed(12, 1024), "texWidth is 1024");
    refused(changed(8, 0xffffffff), "texHeight");
    refused(changed(32, 6), "colorActivation is 6");
    refused(changed(36, 3), "residualActivation is 3");
    refused(changed(40, 18), "nNeurons is 18");
    refused(changed(40, 0xfffffffc), "nNeurons");
    refused(changed(48, 0x400), "newer version");
    refused(changed(84, 0x7fc00000), "camDistance holds nan");
    refused(changed(88, 0x7fffffff), "nTestCameras");
    refused(changed(trailer + 8, 2), "version 2");
    refused(changed(trailer + 12, 0x7fffffff), "claims");
    refused(changed(trailer - 4, 1), "checksum");
    refused(changed(trailer + 16, 0x20202020), "checksum");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_ngsplat(folder / "nowhere"); }), "nowhere");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_ngsplat(folder.path()); }), folder.path().string());
    // The largest count that its header may claim is found to be too much before memory is taken.
    std::string large = good;
    const std::uint32_t count = 4'000'000'000u, rows = (count + 2047u) / 2048;
    std::memcpy(large.data() + 8, &count, 4);
    std::memcpy(large.data() + 16, &rows, 4);
    refused(large, "truncated");
}

}  // namespace
}  // namespace gs::test
