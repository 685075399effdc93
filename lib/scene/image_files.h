// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, in folders where names and extensions may differ a little.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// The extensions of image files, with dot, in lower case, most likely first.
inline constexpr std::string_view kImageExtensions[] = {".png",  ".jpg", ".jpeg", ".bmp",  ".tif", ".tiff",
                                                        ".webp", ".exr", ".jpe",  ".jfif", ".jif"};

/// Returns true if the extension is one of kImageExtensions, in upper or lower case.
bool has_image_extension(const std::filesystem::path& path);

/// Returns true if the extension is one of photographs that are not read, such as HEIC and the raw data of cameras, in
/// upper or lower case.
bool is_unread_photograph(const std::filesystem::path& path);

/// The advice about photographs that are not read.
inline constexpr const char* kConvertPhotographs =
    "convert them to JPEG or PNG, for example with ImageMagick: magick mogrify -format jpg FILES";

/// Returns whether there is such a file, be it readable or not: reading it says why it is not. A name that is too long,
/// as one with a second extension may be, is no file's.
bool names_file(const std::filesystem::path& path);

/// Returns the entries of a folder that have this name, in upper or lower case and composed or decomposed; the one that
/// is spelt so comes first. Throws DataError for a folder that cannot be listed.
std::vector<std::filesystem::path> entries_named(const std::filesystem::path& folder, const std::string& name);

/// Throws DataError if the folder `images` of a scene does not exist, and names the folders with images that there are.
void require_image_folder(const std::filesystem::path& scene, const std::string& images);

/// Removes the extension: "a/b.c.png" -> "a/b.c".
std::string without_extension(const std::string& name);

/// The image files below a folder, named by their relative path with '/'. Links to folders are followed; each folder is
/// listed once, however many links lead to it. Hidden files and folders are passed over ("._a.jpg" of macOS), and so
/// are folders that macOS and network storage keep for themselves ("__MACOSX", "@eaDir").
class ImageFolder {
  public:
    /// A missing folder counts as an empty one. Throws DataError for one that cannot be listed; folders in it that
    /// may not be opened are passed over.
    explicit ImageFolder(const std::filesystem::path& folder);

    const std::filesystem::path& path() const { return folder_; }
    const std::vector<std::string>& names() const { return names_; }  ///< sorted byte-wise

    /// Adds one line about photographs that lie there and are not read, if there are any: to `notes`, or to `facts` if
    /// each has a file beside it that is read.
    void tell_unread(std::vector<std::string>& notes, std::vector<std::string>& facts) const;

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_, unread_;
};

}  // namespace gs
