// SPDX-License-Identifier: Apache-2.0
// Manages the folder that `gsapp export` writes and `gsapp view` serves.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/io/temporary.h"

namespace gs {

/// Files under construction, in a hidden folder beside the target. `publish` renames each file to its final path;
/// without it the destructor removes the files. Throws DataError naming path and reason.
class Staging {
  public:
    explicit Staging(const std::filesystem::path& target);

    const std::filesystem::path& path() const { return work_.path(); }
    /// Returns the files written so far, relative to `path`.
    std::vector<std::filesystem::path> files() const;
    void publish();

  private:
    std::filesystem::path target_;
    WorkFolder work_;
};

/// Throws UsageError if one of the names exists in `folder` (allowed with `overwrite`), or if `folder` is a file.
void require_free(const std::filesystem::path& folder, const std::vector<std::string>& names, bool overwrite);

/// Names of a site's own files, besides the viewer's files (docs/formats.md#the-folder-of-a-site).
namespace site_file {
inline constexpr const char *kScene = "scene.ngsplat", *kSecondScene = "scene-2.ngsplat", *kDescription = "site.json",
                            *kPage = "index.html", *kPreview = "preview.jpg", *kPhotographs = "photographs";
/// Returns the name of the k-th coarser level, counted from 1: scene-level-1.ngsplat.
std::string level(std::size_t k);
/// Returns the path of a test view's photograph, e.g. photographs/00007.png.
std::string photograph(std::size_t index);
}  // namespace site_file

/// Removes from `folder` the files of an earlier export that the later export did not write: second scene, description,
/// preview, coarser levels, and photographs. `written` lists the later export's files, relative to the folder.
void remove_earlier_site(const std::filesystem::path& folder, const std::vector<std::filesystem::path>& written);

/// Returns the folder of the web viewer among the program's own files, or an empty path if it does not exist.
std::filesystem::path viewer_folder();

/// Copies the files of a folder, except links. Throws DataError.
void copy_folder(const std::filesystem::path& from, const std::filesystem::path& to);

/// Removes the files that exports with other versions of `viewer` left in `folder`. The name of such a file differs
/// from a viewer file's name only by the bundler's hash (`assets/index-CUjyNmCg.css`). The viewer must already be in
/// `folder`.
void remove_other_versions(const std::filesystem::path& viewer, const std::filesystem::path& folder);

}  // namespace gs
