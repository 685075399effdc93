// SPDX-License-Identifier: Apache-2.0
// Finds frames by their names and moves new ones into place.
#include "eval/runs/frame_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <set>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"

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
    std::error_code ignored;  // only empty folders are removed: nothing came of them
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
    std::error_code ignored;  // a folder that holds something else stays
    for (const std::string& name : others_) fs::remove((folder_ / name).parent_path(), ignored);
}

}  // namespace gs
