// SPDX-License-Identifier: Apache-2.0
// Copies the scene's options field by field, with designators so that a missing field of SceneOptions is easy to spot.
#include "lib/train/scene_options.h"

#include <filesystem>
#include <string_view>

#include "lib/core/input_file.h"

namespace gs {
namespace {

constexpr std::string_view kBuiltin = "builtin:";

bool is_builtin(const std::string& source) { return source.starts_with(kBuiltin); }

/// Returns the folder of the scene, also if `source` names a file in it.
std::filesystem::path scene_folder(const std::string& source) {
    const std::filesystem::path path = canonical_path(source);
    return path_exists(path) && !folder_exists(path) ? path.parent_path() : path;
}

}  // namespace

SceneOptions scene_options(const TrainOptions& options) {
    return {.source = options.source,
            .images = options.images,
            .resolution = options.resolution,
            .eval = options.eval,
            .test_every = options.test_every,
            .test_list = options.test_list,
            .mask_mode = options.mask_mode,
            .invert_masks = options.invert_masks,
            .alpha_mode = options.alpha_mode,
            .exif = options.ppisp_exif,
            .seed = options.seed};
}

std::string scene_name(const std::string& source) {
    if (!is_builtin(source)) return scene_folder(source).filename().string();
    return std::filesystem::path(source.substr(kBuiltin.size())).stem().string();  // of a file builtin:FILE.yaml
}

std::string dataset_name(const std::string& source) {
    return is_builtin(source) ? "builtin" : scene_folder(source).parent_path().filename().string();
}

}  // namespace gs
