// SPDX-License-Identifier: Apache-2.0
// Finds the masks of a dataset and applies them to views.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "lib/io/image.h"
#include "lib/scene/image_files.h"
#include "lib/scene/scene.h"

namespace gs {

struct MaskFile {
    std::filesystem::path path;
    bool inverted = false;  ///< non-zero pixels are ignored (instant-ngp's dynamic masks)
};

/// Returns X, the name of the masked image with or without its extension, if `name` has the form "X.mask.png";
/// otherwise nothing.
std::optional<std::string> masked_by(const std::string& name);

/// Finds the masks of a dataset's images by their names. Ignores case and Unicode composition of folders and
/// extensions, and also of names unless two files differ only in these.
class MaskFinder {
  public:
    /// `names` are the names of all images, relative to the dataset's folder `root`. `factor` is the divisor by which
    /// the image folder is scaled, whose masks may lie in masks_<factor>/; 1 = none.
    MaskFinder(const std::filesystem::path& root, const std::vector<std::string>& names, int factor);

    /// Returns the mask of an image. Looks in masks_<factor>/, masks/, mask/ and sfm_masks/, for <name>.png,
    /// <name>.mask.png, <name>_mask.png, <stem>.png, <stem>.mask.png and <stem>_mask.png with any extension of an
    /// image. These folders lie in `root`, or beside any folder of the image that has no siblings; sub-folders of mask
    /// folder and image folder match. Then looks beside the image for the names with "mask" in them, and for
    /// dynamic_mask_<stem>, whose meaning is inverted. `name` is relative to `root`, `inner` to the image folder.
    /// Throws DataError if a folder cannot be listed.
    std::optional<MaskFile> find(const std::string& name, const std::string& inner,
                                 const std::filesystem::path& image_path);

    /// Returns whether `name`, listed as an image of the dataset, is the mask of another of its images
    /// ("a.jpg.mask.png").
    bool is_mask(const std::string& name) const;

    /// Returns the mask folders that hold images but gave no mask to any image.
    std::vector<std::filesystem::path> unused() const;

  private:
    /// Image files of one folder, by their case-folded names without extension.
    struct Index {
        std::filesystem::path folder;
        std::multimap<std::string, std::string> names;
        bool used = false;

        Index(const std::filesystem::path& path, const std::vector<std::string>& files);
        std::optional<std::filesystem::path> find(const std::string& stem, const std::string& preferred) const;
    };

    std::vector<Index>& mask_folders(const std::filesystem::path& place);
    const Index& beside(const std::filesystem::path& folder);

    std::filesystem::path root_;
    int factor_;
    std::set<std::string> names_, stems_;                    ///< case-folded
    std::map<std::string, std::set<std::string>> children_;  ///< per folder: its sub-folders, and "" if it has images
    std::map<std::filesystem::path, std::vector<Index>> mask_folders_;
    std::map<std::filesystem::path, Index> beside_;
};

/// Reads a mask and resizes it to the given size. Its values are loss weights: 255 = use, 0 = ignore. `turn` is the
/// EXIF orientation by which the image was turned; a mask oriented like the stored image is turned in the same way.
Image load_mask(const MaskFile& file, bool invert, int width, int height, int turn = 1);

/// Applies SceneOptions::alpha_mode and then mask_mode to a decoded view. AlphaMode::kMask moves the alpha channel
/// into the mask. MaskMode::kTransparent multiplies the mask into the alpha channel. `mask` must have the size of
/// `color`.
ViewImage combine(Image color, std::optional<Image> mask, AlphaMode alpha_mode, MaskMode mask_mode);

}  // namespace gs
