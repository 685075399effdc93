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

/// The extensions of image files, with dot, in lower case, most likely first.
inline constexpr std::string_view kImageExtensions[] = {".png", ".jpg",  ".jpeg", ".bmp",
                                                        ".tif", ".tiff", ".webp", ".exr"};

/// Returns true if the extension is one of kImageExtensions, in upper or lower case.
bool has_image_extension(const std::filesystem::path& path);

/// Returns whether there is such a file, be it readable or not: reading it says why it is not. A name that is too long,
/// as one with a second extension may be, is no file's.
bool names_file(const std::filesystem::path& path);

/// Removes the extension: "a/b.c.png" -> "a/b.c".
std::string without_extension(const std::string& name);

/// The image files below a folder, named by their relative path with '/'.
class ImageFolder {
  public:
    /// A missing folder counts as an empty one. Throws DataError for one that cannot be listed; folders in it that
    /// may not be opened are passed over.
    explicit ImageFolder(const std::filesystem::path& folder);

    /// Returns the file of that name, else a file of the same stem with any image extension (upper or lower case).
    std::optional<std::filesystem::path> find(const std::string& name) const;

    const std::filesystem::path& path() const { return folder_; }
    const std::vector<std::string>& names() const { return names_; }  ///< sorted byte-wise

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_;
    std::map<std::string, std::string> by_stem_;  ///< the first name of each stem
};

}  // namespace gs
