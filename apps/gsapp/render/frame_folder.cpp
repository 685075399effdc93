// SPDX-License-Identifier: Apache-2.0
// Finds frames by name, moves new frames into place, and runs ffmpeg on a folder of images.
#include "apps/gsapp/render/frame_folder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <set>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/core/process.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

bool is_frame(const fs::path& part, const fs::path& name) {
    for (const DepthKind kind : kDepthKinds)
        if (part / name == depth_range_file(kind)) return true;
    const std::string stem = name.stem().string(), extension = name.extension().string();
    return stem.size() >= 5 && stem.find_first_not_of("0123456789") == std::string::npos &&
           (extension == ".png" || extension == ".exr");
}

/// Returns the frames in the folder that are not among `names`.
std::vector<std::string> other_frames(const fs::path& folder, std::vector<std::string> names) {
    std::sort(names.begin(), names.end());
    std::vector<std::string> others;
    for (std::string& name : frames_in(folder))
        if (!std::binary_search(names.begin(), names.end(), name)) others.push_back(std::move(name));
    return others;
}

}  // namespace

fs::path depth_range_file(DepthKind kind) { return fs::path(depth_folder(kind)) / "range.json"; }

std::vector<std::string> frames_in(const fs::path& folder) {
    std::vector<std::string> names;
    const auto add = [&](const fs::path& part) {
        if (!folder_exists(folder / part)) return;
        for (const fs::path& entry : list_folder(folder / part))
            if (is_frame(part, entry.filename())) names.push_back((part / entry.filename()).string());
    };
    add("");
    for (const char* part : kFrameParts) add(part);
    std::sort(names.begin(), names.end());
    return names;
}

FrameFolder::FrameFolder(fs::path folder, std::vector<std::string> names, bool overwrite)
    : folder_(std::move(folder)), names_(std::move(names)), others_(other_frames(folder_, names_)) {
    if (!overwrite && !others_.empty())
        throw UsageError(
            fmt::format("{} holds {} files of another call beside those that this one would write ({}); --overwrite "
                        "removes them, and -o names another folder",
                        folder_.string(), others_.size(), others_[0]));
    for (fs::path at = folder_; !at.empty() && !path_exists(at); at = at.parent_path()) missing_.push_back(at);
    work_ = std::make_unique<WorkFolder>(folder_ / "frames");
}

FrameFolder::~FrameFolder() {
    work_.reset();
    std::error_code ignored;  // removes only folders that stayed empty
    for (const fs::path& made : missing_) fs::remove(made, ignored);
}

void FrameFolder::commit() {
    std::set<fs::path> changed;
    for (const std::string& name : names_) {
        const fs::path target = folder_ / name;
        if (changed.insert(target.parent_path()).second) create_folders(target.parent_path(), target);
        if (std::rename((path() / name).c_str(), target.c_str()) != 0) fail_to_write("replace", target, errno);
    }
    for (const std::string& name : others_) {
        const fs::path target = folder_ / name;
        changed.insert(target.parent_path());
        if (std::remove(target.c_str()) != 0 && errno != ENOENT) fail_to_write("remove", target, errno);
    }
    for (const fs::path& part : changed) sync_folder(part, part);
    std::error_code ignored;  // a folder with other contents stays
    for (const std::string& name : others_) fs::remove((folder_ / name).parent_path(), ignored);
}

namespace {

/// Encoder settings: visually lossless, and small enough to share.
const std::vector<std::string> kMp4 = {"-c:v", "libx264", "-crf", "18", "-movflags", "+faststart", "-f", "mp4"},
                               kWebm = {"-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-row-mt", "1", "-f", "webm"};

/// Crops to even sizes and sets the colour matrix of HD video; without these tags players guess it from the size.
constexpr const char* kFilter = "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709:out_range=tv";

void require_ffmpeg() {
    try {
        const ProcessResult result = run_process({"ffmpeg", "-version"}, {}, [](const std::string&) {});
        if (result.exit_code == 0) return;
        throw UsageError(fmt::format("--video: 'ffmpeg -version' ends with exit code {}: {}", result.exit_code,
                                     fmt::join(result.last_lines, "\n")));
    } catch (const UsageError& e) {
        throw UsageError(
            fmt::format("--video needs ffmpeg to make videos: {}. Install it (Debian and Ubuntu: apt install "
                        "ffmpeg; macOS: brew install ffmpeg; https://ffmpeg.org), or leave --video out",
                        e.what()));
    }
}

/// Returns the file name pattern of the images. A % in the folder's name would count as part of the pattern.
std::string pattern_in(const fs::path& folder) {
    std::string pattern;
    for (const char c : canonical_path(folder).string()) pattern += c == '%' ? "%%" : std::string(1, c);
    return pattern + "/%05d.png";
}

}  // namespace

void require_video(const fs::path& video, const std::vector<View>& views) {
    if (video.extension() != ".mp4" && video.extension() != ".webm")
        throw UsageError(fmt::format("--video {}: the name has to end in .mp4 (H.264) or .webm (VP9)", video.string()));
    const Camera& first = views.at(0).camera;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const Camera& camera = views[i].camera;
        if (camera.width < 2 || camera.height < 2)
            throw UsageError(
                fmt::format("--video: picture {} has {}x{} pixels, and a video needs at least 2x2; --size changes it",
                            i, camera.width, camera.height));
        if (camera.width != first.width || camera.height != first.height)
            throw UsageError(
                fmt::format("--video: picture {} has {}x{} pixels and the first {}x{}; --size gives all the same", i,
                            camera.width, camera.height, first.width, first.height));
    }
    require_ffmpeg();
}

void make_video(const fs::path& video, const fs::path& pictures, std::size_t count, double fps) {
    const fs::path target = canonical_path(video);
    const WorkFolder work(target);
    const fs::path made = canonical_path(work.path()) / "video";
    std::vector<std::string> words = {"ffmpeg", "-nostdin", "-hide_banner", "-v", "error", "-y", "-f", "image2"};
    const auto add = [&](const std::vector<std::string>& more) { words.insert(words.end(), more.begin(), more.end()); };
    add({"-framerate", fmt::format("{}", fps), "-start_number", "0", "-i", pattern_in(pictures)});
    add({"-frames:v", fmt::format("{}", count), "-vf", kFilter, "-pix_fmt", "yuv420p"});
    add({"-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"});
    add(video.extension() == ".mp4" ? kMp4 : kWebm);
    add({made.string()});
    const ProcessResult result = run_process(
        words, {}, [](const std::string&) {}, interrupted);
    if (interrupted()) throw Interrupted(fmt::format("stopped while {} was made", video.string()));
    if (result.exit_code != 0 || !path_exists(made))
        throw DataError(fmt::format("{} was not made: ffmpeg ended with exit code {}{}{}\nThe pictures are in {}.",
                                    video.string(), result.exit_code, result.last_lines.empty() ? "" : ":\n",
                                    fmt::join(result.last_lines, "\n"), pictures.string()));
    if (std::rename(made.c_str(), target.c_str()) != 0) fail_to_write("replace", video, errno);
    sync_folder(target.parent_path(), video);
}

}  // namespace gs
