// SPDX-License-Identifier: Apache-2.0
// Files of other programs given as a model: what they are called, and the advice.
#include "lib/model/model_file.h"

#include <cstring>

#include "kernels/base/error.h"
#include "lib/model/ply.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

using namespace std::string_literals;

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

}  // namespace
}  // namespace gs::test
