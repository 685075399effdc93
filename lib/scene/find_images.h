// SPDX-License-Identifier: Apache-2.0
// Finds the files that the image names of a dataset mean, although folders, extensions or spellings differ.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace gs {

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
