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

struct FoundImage {
    std::optional<std::filesystem::path> file;
    std::string name;           ///< by which the file lies in the folder, with '/'; the given name if there is no file
    bool is_contested = false;  ///< no file, because several could be meant, or another image means the same one
};

struct FoundImages {
    std::vector<FoundImage> images;  ///< one for each name
    std::vector<std::string> notes;  ///< about files in other places and names in other encodings: one line each
    std::vector<std::string> facts;  ///< about other spellings
};

/// Where absolute names and names that leave the folder ("../") come from.
enum class OutsideNames {
    kTaken,    ///< they mean the file of that name if there is one
    kForeign,  ///< they are of another machine, and only their ends tell what they mean
};

/// Finds a file below `folder` for each name. A name means the first of these:
/// - the file of that name, also through links, and with '\' for '/';
/// - the file of that name with an image extension, or the one whose name differs only in that extension, in upper and
///   lower case, or in composed and decomposed letters;
/// - the file whose path ends like the name, or is an end of it, with most folders in common. It must be the only one.
///   Of absolute names any end counts;
/// - the same for a name that is not UTF-8, taken for GBK or another older encoding, or for files with such a name.
/// No file is given to two names. Files of hidden folders, and of those that macOS and network storage keep for
/// themselves, count only if they are named exactly. Throws DataError for folders that cannot be listed.
FoundImages find_images(const std::filesystem::path& folder, const std::vector<std::string>& names,
                        OutsideNames outside);

/// A list of names in which others are looked up by what they mean, as `find_images` does with files.
class NameIndex {
  public:
    explicit NameIndex(const std::vector<std::string>& names);

    struct Match {
        std::size_t index = 0;
        bool same_place = false;  ///< both names have the same folders
        std::string encoding;     ///< the one in which one of the names was read; empty if both are UTF-8
    };
    /// Returns the best match: the very name, or else the one that differs least. Returns nothing if there is none, or
    /// if several are equally good; then sets `ambiguous`.
    std::optional<Match> find(const std::string& name, bool& ambiguous) const;

  private:
    /// A name, or one reading of it.
    struct Entry {
        std::size_t index = 0;
        std::string encoding;
        std::vector<std::string> parts, folded;  ///< of the path: composed; and without upper and lower case as well
    };

    static Entry entry(std::size_t index, std::string text, const std::string& encoding);

    std::map<std::string, std::size_t> by_name_;  ///< exactly as given; of equal ones the first
    std::vector<Entry> entries_;
    std::multimap<std::string, std::size_t> by_last_part_;  ///< folded, both whole and without extension
};

}  // namespace gs
