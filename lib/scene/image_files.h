// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, in folders where names and extensions may differ a little.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// Extensions tried and listed, with dot, lower case, most likely first.
inline constexpr std::string_view kImageExtensions[] = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".exr"};

/// True if the extension is one of kImageExtensions in any case.
bool has_image_extension(const std::filesystem::path& path);

/// "a/b.c.png" -> "a/b.c".
std::string without_extension(const std::string& name);

/// The image files below a folder, by relative path with '/'.
class ImageFolder {
  public:
    /// A missing folder is an empty one.
    explicit ImageFolder(const std::filesystem::path& folder);

    /// The file of that name, else the one of the same stem with any image extension (upper or lower case).
    std::optional<std::filesystem::path> find(const std::string& name) const;

    const std::filesystem::path& path() const { return folder_; }
    const std::vector<std::string>& names() const { return names_; }  ///< sorted byte-wise

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_;
    std::map<std::string, std::string> by_stem_;  ///< first name of each stem
};

}  // namespace gs
