// SPDX-License-Identifier: Apache-2.0
// The output folder of one call of gsapp render, and videos of its frames.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apps/gsapp/render/false_colors.h"
#include "lib/io/temporary.h"
#include "lib/scene/scene.h"

namespace gs {

/// Subfolders that can contain frames, besides the folder itself.
inline constexpr const char* kFrameParts[] = {"full", "base", "residual", "depth", "median_depth", "normals", "alpha"};

/// Returns the path of the file with the range of such depth images.
std::filesystem::path depth_range_file(DepthKind kind);

/// Returns the frames in a folder and in its subfolders of parts: "00012.png", "depth/00012.exr", ..., sorted.
std::vector<std::string> frames_in(const std::filesystem::path& folder);

/// A folder of frames under construction. They are written to path(), a hidden folder inside, and moved by commit():
/// the folder then contains the frames of one call only. Without commit() the folder stays unchanged.
class FrameFolder {
  public:
    /// `names` are the files to be written. Throws UsageError if the folder contains frames of another call that would
    /// remain beside them, unless `overwrite` allows their removal; DataError for a folder that cannot be written.
    FrameFolder(std::filesystem::path folder, std::vector<std::string> names, bool overwrite);
    ~FrameFolder();
    FrameFolder(const FrameFolder&) = delete;
    FrameFolder& operator=(const FrameFolder&) = delete;

    /// Returns the folder to which the frames are written.
    const std::filesystem::path& path() const { return work_->path(); }
    const std::filesystem::path& folder() const { return folder_; }

    /// Moves the files to their final places and removes the frames of other calls. Throws DataError.
    void commit();

  private:
    std::filesystem::path folder_;
    std::vector<std::string> names_, others_;
    std::vector<std::filesystem::path> missing_;  ///< the folder and its ancestors that did not exist
    std::unique_ptr<WorkFolder> work_;
};

/// Checks, before rendering, that a video of these views can be made. Throws UsageError for a name that ends neither in
/// .mp4 nor in .webm, for images of different sizes or below 2x2 pixels, and if ffmpeg is not installed.
void require_video(const std::filesystem::path& video, const std::vector<View>& views);

/// Makes a video from the images 00000.png, ..., of a folder: H.264 or VP9, depending on the file extension, with 8
/// bits and colour at half the resolution, as every player supports. Such videos need even sizes, so an odd last row or
/// column is cropped. Replaces an earlier video of this name. Throws DataError with ffmpeg's last lines if it fails,
/// and Interrupted.
void make_video(const std::filesystem::path& video, const std::filesystem::path& pictures, std::size_t count,
                double fps);

}  // namespace gs
