// SPDX-License-Identifier: Apache-2.0
// Field by field; designated so that a new field of SceneOptions is easy to spot here.
#include "lib/train/scene_options.h"

#include <filesystem>
#include <string_view>

namespace gs {

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
    constexpr std::string_view kBuiltin = "builtin:";
    if (source.starts_with(kBuiltin)) return source.substr(kBuiltin.size());
    std::filesystem::path path = std::filesystem::weakly_canonical(source);
    if (std::filesystem::is_regular_file(path)) path = path.parent_path();
    return path.filename().string();
}

}  // namespace gs
