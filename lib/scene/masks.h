// SPDX-License-Identifier: Apache-2.0
// Finds the masks of a dataset and applies them to views.
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

/// Finds the mask of one image. Looks in masks_<factor>/ (if factor > 1), masks/, mask/ and sfm_masks/ of the scene,
/// keeping sub-folders, for <name>.png, <name>, <stem>.png, <stem>.mask.png and <stem> with any image extension; then
/// for dynamic_mask_<stem>.<ext> beside the image, whose meaning is inverted.
std::optional<MaskFile> find_mask(const std::filesystem::path& scene, const std::string& image_name,
                                  const std::filesystem::path& image_path, int factor);

/// Reads a mask and resizes it to the given size: loss weights, 255 = use, 0 = ignore. `turn` is the EXIF orientation
/// by which the image was turned; a mask that lies as the image was stored is turned with it.
Image load_mask(const MaskFile& file, bool invert, int width, int height, int turn = 1);

/// Applies SceneOptions::alpha_mode and then mask_mode to a decoded view. AlphaMode::kMask moves the alpha channel
/// into the mask. MaskMode::kTransparent multiplies the mask into the alpha channel. `mask` must have the size of
/// `color`.
ViewImage combine(Image color, std::optional<Image> mask, AlphaMode alpha_mode, MaskMode mask_mode);

}  // namespace gs
