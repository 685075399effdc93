// SPDX-License-Identifier: Apache-2.0
// Where masks lie in a dataset, and what they do to a view.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

struct MaskFile {
    std::filesystem::path path;
    bool inverted = false;  ///< non-zero = ignore (instant-ngp's dynamic masks)
};

/// The mask of one image, or nothing. Looked for in masks_<factor>/ (if factor > 1), masks/, mask/ and sfm_masks/ of the scene,
/// keeping sub-folders, as <name>.png, <name>, <stem>.png, <stem>.mask.png and <stem> with any image extension; then as
/// dynamic_mask_<stem>.<ext> beside the image, whose meaning is inverted.
std::optional<MaskFile> find_mask(const std::filesystem::path& scene, const std::string& image_name,
                                  const std::filesystem::path& image_path, int factor);

/// Reads a mask as loss weights (255 = use, 0 = ignore) of the given size.
Image load_mask(const MaskFile& file, bool invert, int width, int height);

/// Applies SceneOptions::alpha_mode and mask_mode to a decoded view, in this order: AlphaMode::kMask moves the alpha channel
/// into the mask; MaskMode::kTransparent moves the mask into the alpha channel (multiplying what is there).
/// `mask` must have the size of `color`.
ViewImage combine(Image color, std::optional<Image> mask, AlphaMode alpha_mode, MaskMode mask_mode);

}  // namespace gs
