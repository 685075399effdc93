// SPDX-License-Identifier: Apache-2.0
// Calls ffmpeg on a folder of pictures.
#include "eval/runs/video.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cerrno>
#include <cstdio>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/core/process.h"
#include "lib/io/temporary.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

/// Visually lossless, and small enough to be sent around.
const std::vector<std::string> kMp4 = {"-c:v", "libx264", "-crf", "18", "-movflags", "+faststart", "-f", "mp4"},
                               kWebm = {"-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-row-mt", "1", "-f", "webm"};

/// Even sizes, and the colours of HD video; without the tags players guess by the size.
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

/// Returns the pattern of the pictures' names. A % in the name of the folder would be part of it.
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
