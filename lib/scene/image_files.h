// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, even if names and extensions in the folder differ slightly.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// Extensions of image files, with the dot, in lower case, most likely first.
inline constexpr std::string_view kImageExtensions[] = {".png",  ".jpg", ".jpeg", ".bmp",  ".tif", ".tiff",
                                                        ".webp", ".exr", ".jpe",  ".jfif", ".jif"};

/// Returns true if the extension is one of kImageExtensions, in upper or lower case.
bool has_image_extension(const std::filesystem::path& path);

/// Returns true if the extension, in upper or lower case, belongs to an unsupported photograph format, such as HEIC or
/// a camera's raw format.
bool is_unread_photograph(const std::filesystem::path& path);

/// Advice for photographs in unsupported formats.
inline constexpr const char* kConvertPhotographs =
    "convert them to JPEG or PNG, for example with ImageMagick: magick mogrify -format jpg FILES";

/// Returns whether the file exists, readable or not: reading it later reports the reason. Returns false for a name that
/// is too long, as a name with an added extension may be.
bool names_file(const std::filesystem::path& path);

/// Returns the entries of a folder that have this name, ignoring case and Unicode composition; an exact match comes
/// first. Throws DataError if the folder cannot be listed.
std::vector<std::filesystem::path> entries_named(const std::filesystem::path& folder, const std::string& name);

/// Throws DataError if the folder `images` of a scene does not exist, and lists the existing folders with images.
void require_image_folder(const std::filesystem::path& scene, const std::string& images);

/// Removes the extension: "a/b.c.png" -> "a/b.c".
std::string without_extension(const std::string& name);

/// The image files below a folder, named by their relative path with '/'. Links to folders are followed; each folder is
/// listed once, however many links lead to it. Hidden files and folders are skipped ("._a.jpg" of macOS), and so are
/// the private folders of macOS and network storage ("__MACOSX", "@eaDir").
class ImageFolder {
  public:
    /// Lists the folder; a missing folder counts as empty. Throws DataError if it cannot be listed. Sub-folders without
    /// permission are skipped.
    explicit ImageFolder(const std::filesystem::path& folder);

    const std::filesystem::path& path() const { return folder_; }
    const std::vector<std::string>& names() const { return names_; }  ///< sorted byte-wise

    /// Adds one line about photographs in unsupported formats, if the folder has any: to `notes`, or to `facts` if each
    /// of them has a readable file beside it.
    void tell_unread(std::vector<std::string>& notes, std::vector<std::string>& facts) const;

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_, unread_;
};

struct FoundImage {
    std::optional<std::filesystem::path> file;
    std::string name;           ///< relative path in the folder, with '/'; the given name if there is no file
    bool is_contested = false;  ///< no file, because several match, or another image matches the same one
};

struct FoundImages {
    std::vector<FoundImage> images;  ///< one per name
    std::vector<std::string> notes;  ///< lines about files in other places and names in other encodings
    std::vector<std::string> facts;  ///< lines about other spellings
};

/// Treatment of absolute names and names that leave the folder ("../").
enum class OutsideNames {
    kTaken,    ///< accepted: they match the file of that name if it exists
    kForeign,  ///< from another machine: only the end of the path is matched
};

/// Finds a file below `folder` for each name. A name matches the first of these:
/// - the file of that name, also through links, and with '\' in place of '/';
/// - the file of that name with an image extension, or the file whose name differs only in that extension, in case, or
///   in Unicode composition;
/// - the only file whose path ends with the name, or is itself an end of the name, with the most folders in common. For
///   absolute names any end counts;
/// - the same if the name, or the file's name, is not UTF-8 and is read as GBK or another older encoding.
/// No file is assigned to two names. Files in hidden folders, and in the private folders of macOS and network storage,
/// match only exact names. Throws DataError for folders that cannot be listed.
FoundImages find_images(const std::filesystem::path& folder, const std::vector<std::string>& names,
                        OutsideNames outside);

/// An index of names with approximate lookup, by the rules that `find_images` applies to files.
class NameIndex {
  public:
    explicit NameIndex(const std::vector<std::string>& names);

    struct Match {
        std::size_t index = 0;
        bool same_place = false;  ///< both names have the same folders
        std::string encoding;     ///< encoding in which one of the names was read; empty if both are UTF-8
    };
    /// Returns the best match: the identical name, or else the name that differs least. Returns nothing if there is no
    /// match. Returns nothing and sets `ambiguous` if several matches are equally good.
    std::optional<Match> find(const std::string& name, bool& ambiguous) const;

  private:
    /// A name, or its interpretation in one encoding.
    struct Entry {
        std::size_t index = 0;
        std::string encoding;
        std::vector<std::string> parts, folded;  ///< path components: composed, and also case-folded
    };

    static Entry entry(std::size_t index, std::string text, const std::string& encoding);

    std::map<std::string, std::size_t> by_name_;  ///< exact names; the first of equal ones
    std::vector<Entry> entries_;
    std::multimap<std::string, std::size_t> by_last_part_;  ///< keys: folded, both whole and without extension
};

}  // namespace gs
