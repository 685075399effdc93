// SPDX-License-Identifier: Apache-2.0
// The folder of the frames of one call of gsapp render, and videos of them.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apps/gsapp/render/false_colors.h"
#include "lib/io/temporary.h"
#include "lib/scene/scene.h"

namespace gs {

/// What frames can lie in, besides the folder itself.
inline constexpr const char* kFrameParts[] = {"full", "base", "residual", "depth", "median_depth", "normals", "alpha"};

/// Returns the file that states the range of such depth pictures.
std::filesystem::path depth_range_file(DepthKind kind);

/// Returns the frames in a folder and in the folders of their parts: "00012.png", "depth/00012.exr", ..., sorted.
std::vector<std::string> frames_in(const std::filesystem::path& folder);

/// A folder whose frames are being made. They are written to path(), a hidden folder inside, and commit() moves them:
/// the folder then holds the frames of one call alone. Without commit() it stays as it was.
class FrameFolder {
  public:
    /// `names` are the files to come. Throws UsageError if the folder holds frames of another call that would stay
    /// beside them, unless `overwrite` allows their removal; DataError for a folder that cannot be written.
    FrameFolder(std::filesystem::path folder, std::vector<std::string> names, bool overwrite);
    ~FrameFolder();
    FrameFolder(const FrameFolder&) = delete;
    FrameFolder& operator=(const FrameFolder&) = delete;

    /// Returns where the frames are written.
    const std::filesystem::path& path() const { return work_->path(); }
    const std::filesystem::path& folder() const { return folder_; }

    /// Moves the files to their places and removes the frames of other calls. Throws DataError.
    void commit();

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_, others_;
    std::vector<std::filesystem::path> missing_;  ///< the folder and those above it that did not exist
    std::unique_ptr<WorkFolder> work_;
};

/// Checks, before anything is rendered, that a video of these views can be made. Throws UsageError for a name that ends
/// neither in .mp4 nor in .webm, for pictures of different sizes or of fewer than 2x2 pixels, and if ffmpeg is not
/// installed.
void require_video(const std::filesystem::path& video, const std::vector<View>& views);

/// Makes a video of the pictures 00000.png, ..., of a folder: H.264 or VP9, by the ending of the name, with 8 bits and
/// colour at half the resolution, as every player shows it. Such videos have even sizes, so an odd last row or column
/// is cut off. An earlier video of this name is replaced. Throws DataError with ffmpeg's last lines if it fails, and
/// Interrupted.
void make_video(const std::filesystem::path& video, const std::filesystem::path& pictures, std::size_t count,
                double fps);

}  // namespace gs
