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
    bool inverted = false;  ///< non-zero = ignore (instant-ngp's dynamic masks)
};

/// Returns the name of the image that a name "X.mask.png" belongs to, which is X with or without its extension; nothing
/// for other names.
std::optional<std::string> masked_by(const std::string& name);

/// Finds the masks of a dataset's images by their names. Folders, extensions and, unless two files differ only so,
/// names may be in upper or lower case, and composed or decomposed.
class MaskFinder {
  public:
    /// `names` are those of all images, relative to the dataset's folder `root`. `factor` is the divisor of the image
    /// folder, whose masks may lie in masks_<factor>/; 1 = none.
    MaskFinder(const std::filesystem::path& root, const std::vector<std::string>& names, int factor);

    /// Returns the mask of an image. Looks in masks_<factor>/, masks/, mask/ and sfm_masks/, for <name>.png,
    /// <name>.mask.png, <name>_mask.png, <stem>.png, <stem>.mask.png and <stem>_mask.png with any extension of an
    /// image. These folders lie in `root`, and beside any folder of the image without siblings: sub-folders of both
    /// match. Then looks beside the image for the names with "mask" in them, and for dynamic_mask_<stem>, whose meaning
    /// is inverted. `name` is relative to `root`, `inner` to the image folder. Throws DataError for folders that cannot
    /// be listed.
    std::optional<MaskFile> find(const std::string& name, const std::string& inner,
                                 const std::filesystem::path& image_path);

    /// Returns whether the dataset lists the mask of another of its images as an image, as "a.jpg.mask.png" is.
    bool is_mask(const std::string& name) const;

    /// Returns the folders of masks that hold images of which none was found.
    std::vector<std::filesystem::path> unused() const;

  private:
    /// Image files by their names without extension and without upper and lower case.
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
    std::set<std::string> names_, stems_;                    ///< without upper and lower case
    std::map<std::string, std::set<std::string>> children_;  ///< of each folder: folders, and "" for images
    std::map<std::filesystem::path, std::vector<Index>> mask_folders_;
    std::map<std::filesystem::path, Index> beside_;
};

/// Reads a mask and resizes it to the given size: loss weights, 255 = use, 0 = ignore. `turn` is the EXIF orientation
/// by which the image was turned; a mask that lies as the image was stored is turned with it.
Image load_mask(const MaskFile& file, bool invert, int width, int height, int turn = 1);

/// Applies SceneOptions::alpha_mode and then mask_mode to a decoded view. AlphaMode::kMask moves the alpha channel
/// into the mask. MaskMode::kTransparent multiplies the mask into the alpha channel. `mask` must have the size of
/// `color`.
ViewImage combine(Image color, std::optional<Image> mask, AlphaMode alpha_mode, MaskMode mask_mode);

}  // namespace gs
