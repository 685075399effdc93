// SPDX-License-Identifier: Apache-2.0
// Extracts candidates with ffmpeg and keeps the sharpest of each interval.
#include "lib/scene/video_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <regex>
#include <string>
#include <vector>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr std::int64_t kCandidates = 5;  // per interval: neighbours of a blurred frame at 30 a second are often sharp

/// Reads the seconds of "  Duration: 00:01:02.50, start: ..."; 0 for other lines.
double duration_in(const std::string& line) {
    static const std::regex kDuration(R"(Duration: (\d{1,4}):(\d\d):(\d\d(?:\.\d+)?))");
    std::smatch match;
    if (!std::regex_search(line, match, kDuration)) return 0;
    return 3600 * std::stod(match[1]) + 60 * std::stod(match[2]) + std::stod(match[3]);
}

/// Reads the number in "frame=12", a line of ffmpeg's reports for programs; -1 for other lines.
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
    // "file:" keeps names with a colon from being taken for addresses.
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

}  // namespace gs
