// SPDX-License-Identifier: Apache-2.0
// Readers of trained models.
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/io/safetensors.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "lib/model/ppisp_json.h"
#include "tests/fuzz/target.h"
#include "tests/model/model_helpers.h"

namespace gs::fuzz {
namespace {

namespace fs = std::filesystem;

Gaussians few(const char* model, int degree, bool with_moments = false) {
    return test::random_gaussians(2, {model, degree, ColorActivation::kSoftplus}, with_moments);
}

std::vector<std::string> plys() {
    std::vector<std::string> seeds;
    for (const auto& [model, degree] : {std::pair{"sh", 1}, {"none", 0}, {"nasg", 1}})
        seeds.push_back(written("model.ply", [&](const fs::path& path) { write_ply(path, few(model, degree), {}); }));
    return seeds;
}

std::vector<std::string> checkpoints() {
    std::vector<std::string> seeds;
    for (const bool with_moments : {true, false}) {
        Checkpoint checkpoint{few("sh", 1, with_moments), 7, 3, "source: x\n"};
        if (with_moments) checkpoint.state.ppisp = identity_ppisp(2, 1);
        seeds.push_back(written("c.safetensors", [&](const fs::path& path) { write_checkpoint(path, checkpoint); }));
    }
    return seeds;
}

void read_all_tensors(const std::string& bytes) {
    const SafetensorsFile file(put("t.safetensors", bytes));
    for (const auto& [name, tensor] : file.tensors()) {
        switch (tensor.dtype) {
            case Dtype::kF32:
                file.read<float>(name);
                break;
            case Dtype::kF64:
                file.read<double>(name);
                break;
            case Dtype::kI64:
                file.read<std::int64_t>(name);
                break;
            case Dtype::kU8:
                file.read<std::uint8_t>(name);
                break;
        }
    }
}

std::vector<std::string> tensors() {
    const float a[] = {1, 2, 3, 4};
    const double b[] = {1, 2};
    const std::int64_t c[] = {-1};
    const std::uint8_t d[] = {1, 2, 3};
    const TensorView views[] = {{"a", Dtype::kF32, {2, 2}, a},
                                {"b", Dtype::kF64, {2}, b},
                                {"c", Dtype::kI64, {}, c},
                                {"d", Dtype::kU8, {3, 1}, d}};
    return {written("t.safetensors", [&](const fs::path& path) {
        write_safetensors(path, views, {{"key", "value"}});
    })};
}

std::vector<std::string> corrections() {
    PpispFile file;
    file.iteration = 7;
    file.exif = true;
    file.frames = {{"a.jpg", 0, -7.5}, {"b/c.jpg", 1}};
    file.state = identity_ppisp(2, 2);
    return {written("ppisp.json", [&](const fs::path& path) { write_ppisp_json(path, file); })};
}

/// Scenes are padded to 2048 Gaussians, so even the smallest is some 100 KB of zeros.
std::vector<std::string> packed_scenes() {
    std::vector<std::string> seeds;
    PackedScene scene = pack_gaussians(few("none", 0));
    seeds.push_back(written("s.ngsplat", [&](const fs::path& path) { write_ngsplat(path, scene); }));
    scene.cameras = {PackedCamera{}};
    scene.ppisp = PackedPpisp{};
    scene.ppisp->views = {PackedFrame{}};
    scene.trailer = R"({"appearance":"x"})";
    seeds.push_back(written("s.ngsplat", [&](const fs::path& path) { write_ngsplat(path, scene); }));
    return seeds;
}

}  // namespace

std::vector<Target> model_targets() {
    return {
        {"model.ply", plys, [](const std::string& bytes) { read_ply(put("model.ply", bytes)); }},
        {"tensors.safetensors", tensors, read_all_tensors},
        {"checkpoint.safetensors", checkpoints,
         [](const std::string& bytes) { read_checkpoint(put("c.safetensors", bytes)); }},
        {"ppisp.json", corrections, [](const std::string& bytes) { read_ppisp_json(put("ppisp.json", bytes)); }},
        {"scene.ngsplat", packed_scenes, [](const std::string& bytes) { read_ngsplat(put("s.ngsplat", bytes)); }},
    };
}

}  // namespace gs::fuzz
