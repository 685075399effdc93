// SPDX-License-Identifier: Apache-2.0
// Checks, arranges and replaces scene folders.
#include "lib/scene/prepared_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <vector>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/io/atomic_file.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr const char* kFailedLog = "colmap-failed.log";

bool lies_within(const fs::path& inner, const fs::path& outer) {
    const fs::path relative = canonical_path(inner).lexically_relative(canonical_path(outer));
    return !relative.empty() && *relative.begin() != "..";
}

/// Flushes colmap's output to disk, so that it survives a power cut and write errors of a full disk are detected.
void sync_scene(const fs::path& scene) {
    const int fd = ::open(scene.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const int error = fd >= 0 && ::syncfs(fd) == 0 ? 0 : errno;
    if (fd >= 0) ::close(fd);
    if (error != 0) fail_to_write("write", scene, error);
}

}  // namespace

void check_target(const fs::path& source, const fs::path& scene, bool overwrite) {
    if (lies_within(scene, source))
        throw UsageError(fmt::format("{} lies inside the folder of photographs {}; give another -o", scene.string(),
                                     source.string()));
    if (!path_exists(scene)) return;
    const std::string target = scene.string();
    if (lies_within(source, scene))
        throw UsageError(fmt::format("{} holds the photographs {} and cannot be replaced; give another -o", target,
                                     source.string()));
    if (folder_exists(scene)) {
        std::vector<fs::path> entries = list_folder(scene);
        std::erase_if(entries, [](const fs::path& entry) { return entry.filename() == kFailedLog; });
        if (entries.empty()) return;
    }
    if (!folder_exists(scene / "sparse"))
        throw UsageError(fmt::format("{} exists and is not a scene; give another -o", target));
    if (!overwrite) throw UsageError(fmt::format("{} exists; --overwrite replaces it", target));
}

void arrange_scene(const fs::path& dense) {
    std::vector<fs::path> models, superfluous;
    for (const auto& entry : fs::directory_iterator(dense / "sparse")) {
        if (entry.is_regular_file()) models.push_back(entry.path());
    }
    if (models.empty() || !fs::is_directory(dense / "images"))
        throw DataError("colmap image_undistorter reported success but wrote no scene");
    fs::create_directories(dense / "sparse" / "0");
    for (const fs::path& file : models) fs::rename(file, dense / "sparse" / "0" / file.filename());
    for (const auto& entry : fs::directory_iterator(dense)) {
        if (entry.path().filename() != "images" && entry.path().filename() != "sparse")
            superfluous.push_back(entry.path());
    }
    for (const fs::path& path : superfluous) fs::remove_all(path);
}

void put_in_place(const fs::path& scene, const fs::path& target) {
    sync_scene(scene);
    const fs::path old = target.string() + fmt::format(".replaced-{}", ::getpid());
    const bool replaces = fs::exists(fs::symlink_status(target));
    if (replaces) fs::rename(target, old);
    try {
        fs::rename(scene, target);
    } catch (const fs::filesystem_error& e) {
        std::error_code error;
        if (replaces) fs::rename(old, target, error);
        if (error)
            throw DataError(fmt::format("{}: {}; the earlier scene is now in {}", target.string(), e.code().message(),
                                        old.string()));
        throw;
    }
    sync_folder(target.parent_path(), target);
    fs::remove_all(old);
}

std::string keep_failed_log(const fs::path& log, const fs::path& target) {
    const fs::path kept = target / kFailedLog;
    try {
        copy_file_atomic(log, kept);
    } catch (const std::exception& e) {  // the original error is the one to report
        return fmt::format("; its output could not be kept: {}", e.what());
    }
    return fmt::format("\nall that was printed is in {}", kept.string());
}

}  // namespace gs
