// SPDX-License-Identifier: Apache-2.0
// Searches a folder of photographs and turns the ones that lie on their side; extracts frames of a video with ffmpeg
// and keeps the sharpest of each interval.
#include "lib/scene/photographs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <regex>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/io/atomic_file.h"
#include "lib/io/temporary.h"
#include "lib/scene/image_files.h"
#include "lib/scene/masks.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr std::int64_t kCandidates = 5;  // per interval: at 30 fps the neighbours of a blurred frame are often sharp

/// Parses the seconds from "  Duration: 00:01:02.50, start: ...". Returns 0 for other lines.
double duration_in(const std::string& line) {
    static const std::regex kDuration(R"(Duration: (\d{1,4}):(\d\d):(\d\d(?:\.\d+)?))");
    std::smatch match;
    if (!std::regex_search(line, match, kDuration)) return 0;
    return 3600 * std::stod(match[1]) + 60 * std::stod(match[2]) + std::stod(match[3]);
}

/// Parses the number from "frame=12", a line of ffmpeg's machine-readable progress. Returns -1 for other lines.
std::int64_t frame_in(const std::string& line) {
    static const std::regex kFrame(R"(frame=\s*(\d{1,12}))");
    std::smatch match;
    return std::regex_match(line, match, kFrame) ? std::stoll(match[1]) : -1;
}

void extract_candidates(const fs::path& video, double rate, const fs::path& folder, ProgramLog& log,
                        const std::function<void(std::int64_t, std::int64_t)>& progress) {
    std::string pattern;
    for (const char c : folder.string()) pattern += c == '%' ? "%%" : std::string(1, c);
    std::int64_t total = 0;
    // "file:" prevents ffmpeg from reading names with a colon as URLs.
    log.run("ffmpeg",
            {"ffmpeg", "-hide_banner", "-nostdin", "-nostats", "-progress", "pipe:1", "-i", "file:" + video.string(),
             "-vf", fmt::format("fps={:.9g}", rate), "-q:v", "2", "-start_number", "0", pattern + "/%08d.jpg"},
            [&](const std::string& line) {
                if (const double seconds = duration_in(line); seconds > 0 && total == 0)
                    total = std::llround(seconds * rate);
                if (const std::int64_t frame = frame_in(line); frame >= 0)
                    progress(total > 0 ? std::min(frame, total) : frame, total);
            });
}

/// Creates a link, or a copy on file systems without links (exFAT, network folders). Throws DataError.
void link_or_copy(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::create_symlink(fs::canonical(from), to, error);
    if (error) copy_file_atomic(from, to);
}

}  // namespace

double sharpness(const Image& image) {
    const auto luma = [&](int x, int y) {
        return 0.299 * image.value(x, y, 0) + 0.587 * image.value(x, y, 1) + 0.114 * image.value(x, y, 2);
    };
    double sum = 0, squares = 0;
    for (int y = 1; y + 1 < image.height; ++y)
        for (int x = 1; x + 1 < image.width; ++x) {
            const double value = luma(x - 1, y) + luma(x + 1, y) + luma(x, y - 1) + luma(x, y + 1) - 4 * luma(x, y);
            sum += value;
            squares += value * value;
        }
    const double count = double(std::max(0, image.width - 2)) * std::max(0, image.height - 2);
    return count > 0 ? squares / count - (sum / count) * (sum / count) : 0;
}

void extract_frames(const fs::path& video, double fps, const fs::path& folder, ProgramLog& log,
                    const std::function<void(std::int64_t, std::int64_t)>& progress) {
    const WorkFolder candidates(folder);
    fs::create_directories(folder);
    extract_candidates(video, fps * kCandidates, candidates.path(), log, progress);
    const std::vector<fs::path> files = list_folder(candidates.path());
    std::vector<double> scores(files.size());
    parallel_for(std::int64_t(files.size()), [&](std::int64_t i) {
        if (!interrupted()) scores[std::size_t(i)] = sharpness(read_image(files[std::size_t(i)]));
    });
    if (interrupted()) throw Interrupted("stopped while frames were chosen");
    std::size_t kept = 0;
    for (std::size_t first = 0; first < files.size(); first += kCandidates, ++kept) {
        const std::size_t end = std::min(files.size(), first + std::size_t(kCandidates));
        const auto best =
            std::max_element(scores.begin() + std::ptrdiff_t(first), scores.begin() + std::ptrdiff_t(end));
        fs::rename(files[std::size_t(best - scores.begin())], folder / fmt::format("frame_{:05}.jpg", kept));
    }
    if (kept < 2)
        throw DataError(
            fmt::format("{}: gives {} frames at {:g} a second; a scene needs many (--fps)", video.string(), kept, fps));
}

Photographs find_photographs(const fs::path& images) {
    std::error_code error;
    Photographs found;
    for (fs::recursive_directory_iterator it(images, error), end; !error && it != end; it.increment(error)) {
        if (std::error_code ignored; !it->is_regular_file(ignored)) continue;
        const fs::path name = it->path().lexically_relative(images);
        // Other files, such as exiftool's "1.jpg_original" and raw photographs, may have an orientation, too.
        if (has_image_extension(name))
            found.names.push_back(name.generic_string());
        else
            found.others.push_back(name);
    }
    if (error) throw DataError(fmt::format("{}: cannot be read: {}", images.string(), error.message()));
    const MaskFinder finder(images, found.names, 1);
    const auto masks = std::stable_partition(found.names.begin(), found.names.end(),
                                             [&](const std::string& name) { return !finder.is_mask(name); });
    found.masks.assign(masks, found.names.end());
    found.names.erase(masks, found.names.end());
    for (const std::string& name : found.names) {
        bool turned = false;
        try {
            const ImageInfo info = read_image_info(images / name);
            turned = info.orientation != 1;
            found.stored_sizes.insert({info.width, info.height});
            const bool quarter = is_quarter_turn(info.orientation);
            found.upright_sizes.insert({quarter ? info.height : info.width, quarter ? info.width : info.height});
        } catch (const DataError&) {
            // colmap skips unreadable files, too.
        }
        (turned ? found.turned : found.others).push_back(name);
    }
    std::vector<std::string> facts;
    ImageFolder(images).tell_unread(found.notes, facts);
    if (found.stored_sizes.empty())
        throw DataError(fmt::format("{}: no photographs found{}{}", images.string(), found.notes.empty() ? "" : "; ",
                                    fmt::join(found.notes, "; ")));
    std::sort(found.names.begin(), found.names.end());
    return found;
}

void write_upright(const fs::path& images, const Photographs& photographs, const fs::path& folder) {
    for (const auto* names : {&photographs.turned, &photographs.others})
        for (const fs::path& name : *names) fs::create_directories((folder / name).parent_path());
    for (const fs::path& name : photographs.others)
        if (!interrupted()) link_or_copy(images / name, folder / name);
    parallel_for(std::int64_t(photographs.turned.size()), [&](std::int64_t i) {
        if (!interrupted()) write_upright_copy(images / photographs.turned[i], folder / photographs.turned[i]);
    });
    if (interrupted()) throw Interrupted("stopped while photographs were turned upright");
}

}  // namespace gs
