// SPDX-License-Identifier: Apache-2.0
// The folder that `gsapp export` writes and `gsapp view` serves.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gs {

/// Files under construction, in a hidden folder beside the target. `publish` renames each to its place; an object destroyed without it
/// leaves nothing behind. Throws DataError naming path and reason.
class Staging {
  public:
    explicit Staging(const std::filesystem::path& target);
    ~Staging();
    Staging(const Staging&) = delete;
    Staging& operator=(const Staging&) = delete;

    const std::filesystem::path& path() const { return path_; }
    void publish();

  private:
    std::filesystem::path target_, path_;
};

/// Throws UsageError when one of the names exists in `folder`, or `folder` is a file, unless `overwrite`.
void require_free(const std::filesystem::path& folder, const std::vector<std::string>& names, bool overwrite);

/// The built web viewer; empty where it was not built. How to build it is in README.md.
std::filesystem::path viewer_folder();

/// Copies the files of a folder, links excepted.
void copy_folder(const std::filesystem::path& from, const std::filesystem::path& to);

/// Removes what exports with other versions of `viewer` left in `folder`: files beside its own whose name differs in nothing but the hash that
/// the bundler gave it (`assets/index-CUjyNmCg.css`). To be called when the viewer is in `folder`.
void remove_other_versions(const std::filesystem::path& viewer, const std::filesystem::path& folder);

}  // namespace gs
