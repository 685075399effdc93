// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, in folders where names and extensions may differ a little.
#include "lib/scene/image_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <set>
#include <system_error>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/utf8.h"

namespace gs {

namespace fs = std::filesystem;

namespace {

std::string folded_extension(const fs::path& path) { return case_folded(path.extension().string()); }

constexpr std::string_view kUnreadExtensions[] = {
    ".heic", ".heif", ".hif", ".avif", ".jxl", ".jp2", ".gif", ".tga", ".psd",  // phones, web, programs
    ".dng",  ".cr2",  ".cr3", ".crw",  ".nef", ".nrw", ".arw", ".srf", ".sr2",  // raw data of cameras
    ".orf",  ".rw2",  ".raf", ".pef",  ".srw", ".x3f", ".3fr", ".iiq", ".rwl", ".raw"};

bool is_litter(const fs::path& path) {
    const std::string name = path.filename().string();
    return name.starts_with('.') || name == "__MACOSX" || name == "@eaDir" || name == "#recycle" ||
           name == "$RECYCLE.BIN";
}

}  // namespace

bool has_image_extension(const fs::path& path) {
    return std::ranges::find(kImageExtensions, folded_extension(path)) != std::end(kImageExtensions);
}

bool is_unread_photograph(const fs::path& path) {
    return std::ranges::find(kUnreadExtensions, folded_extension(path)) != std::end(kUnreadExtensions);
}

bool names_file(const fs::path& path) {
    std::error_code error;
    const fs::file_type type = fs::status(path, error).type();
    return error != std::errc::filename_too_long && type != fs::file_type::not_found &&
           type != fs::file_type::directory;
}

std::vector<fs::path> entries_named(const fs::path& folder, const std::string& name) {
    std::vector<fs::path> found;
    for (const fs::path& entry : list_folder(folder))
        if (case_folded(entry.filename().string()) == case_folded(name)) found.push_back(entry);
    std::stable_partition(found.begin(), found.end(), [&](const fs::path& entry) { return entry.filename() == name; });
    return found;
}

std::string without_extension(const std::string& name) {
    const std::string extension = fs::path(name).extension().string();
    return name.substr(0, name.size() - extension.size());
}

ImageFolder::ImageFolder(const fs::path& folder) : folder_(folder) {
    if (!folder_exists(folder)) return;
    list_folder(folder);  // throws for a folder that may not be opened; those below are passed over
    std::set<fs::path> listed;
    // Links come last, so that a folder is listed under its own name and not under that of a link to it.
    std::deque<fs::path> folders{folder}, links;
    while (!folders.empty() || !links.empty()) {
        std::deque<fs::path>& queue = folders.empty() ? links : folders;
        const fs::path next = queue.front();
        queue.pop_front();
        std::error_code error;
        if (!listed.insert(fs::canonical(next, error)).second || error) continue;
        fs::directory_iterator it(next, fs::directory_options::skip_permission_denied, error);
        for (const fs::directory_iterator end; !error && it != end; it.increment(error)) {
            const fs::path& entry = it->path();
            std::error_code ignored;
            if (is_litter(entry)) continue;
            if (it->is_directory(ignored))
                (it->is_symlink(ignored) ? links : folders).push_back(entry);
            else if (has_image_extension(entry) || is_unread_photograph(entry))
                (has_image_extension(entry) ? names_ : unread_)
                    .push_back(entry.lexically_relative(folder).generic_string());
        }
        if (error) throw DataError(fmt::format("{}: cannot be listed: {}", next.string(), error.message()));
    }
    std::ranges::sort(names_);
    std::ranges::sort(unread_);
}

void ImageFolder::tell_unread(std::vector<std::string>& notes, std::vector<std::string>& facts) const {
    if (unread_.empty()) return;
    std::set<std::string> stems;
    for (const std::string& name : names_) stems.insert(without_extension(name));
    const auto alone = std::ranges::find_if(
        unread_, [&](const std::string& name) { return !stems.contains(without_extension(name)); });
    const std::string line =
        fmt::format("{}: {} photographs are in formats that are not read: passed over (first: {})", folder_.string(),
                    unread_.size(), alone == unread_.end() ? unread_[0] : *alone);
    if (alone == unread_.end())
        facts.push_back(line + ", because each has a file beside it that is read");
    else
        notes.push_back(fmt::format("{}; {}", line, kConvertPhotographs));
}

void require_image_folder(const fs::path& scene, const std::string& images) {
    if (folder_exists(scene / images)) return;
    std::vector<std::string> others;
    for (const fs::path& folder : list_folder(scene.empty() ? "." : scene))
        if (folder_exists(folder) && !ImageFolder(folder).names().empty()) others.push_back(folder.filename().string());
    throw DataError(fmt::format("{}: image folder '{}' does not exist; {} (choose another with --images)",
                                scene.string(), images,
                                others.empty() ? "no folder here holds images"
                                               : fmt::format("folders with images are {}", fmt::join(others, ", "))));
}

}  // namespace gs
