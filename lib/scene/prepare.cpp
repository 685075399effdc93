// SPDX-License-Identifier: Apache-2.0
// Runs colmap's four stages.
#include "lib/scene/prepare.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <set>
#include <vector>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/process.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image.h"
#include "lib/io/orientation.h"
#include "lib/io/temporary.h"
#include "lib/scene/image_files.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr int kNumStages = 4;

bool lies_within(const fs::path& inner, const fs::path& outer) {
    const fs::path relative = canonical_path(inner).lexically_relative(canonical_path(outer));
    return !relative.empty() && *relative.begin() != "..";
}

/// Checks the target first, because colmap may run for hours. Throws UsageError.
void check_target(const PrepareOptions& options) {
    if (lies_within(options.scene, options.images))
        throw UsageError(fmt::format("{} lies inside the folder of photographs {}; give another -o",
                                     options.scene.string(), options.images.string()));
    if (!path_exists(options.scene)) return;
    const std::string target = options.scene.string();
    if (lies_within(options.images, options.scene))
        throw UsageError(fmt::format("{} holds the photographs {} and cannot be replaced; give another -o", target,
                                     options.images.string()));
    if (folder_exists(options.scene) && list_folder(options.scene).empty()) return;
    if (!folder_exists(options.scene / "sparse"))
        throw UsageError(fmt::format("{} exists and is not a scene; give another -o", target));
    if (!options.overwrite) throw UsageError(fmt::format("{} exists; --overwrite replaces it", target));
}

/// What lies in a folder of photographs, by path relative to it.
struct Photographs {
    std::set<std::pair<int, int>> stored_sizes, upright_sizes;  ///< width and height, pixels
    std::size_t count = 0;
    std::vector<fs::path> turned, others;  ///< photographs whose EXIF orientation is not 1; all other files

    /// Upright and level photographs of one device have two sizes once turned, and would no longer share one camera for
    /// colmap. A camera for each photograph is worse than pictures that lie on their side.
    bool should_turn() const { return !turned.empty() && upright_sizes.size() <= stored_sizes.size(); }
};

/// Throws DataError when there are no photographs.
Photographs find_photographs(const fs::path& images) {
    std::error_code error;
    Photographs found;
    for (fs::recursive_directory_iterator it(images, error), end; !error && it != end; it.increment(error)) {
        if (std::error_code ignored; !it->is_regular_file(ignored)) continue;
        const fs::path name = it->path().lexically_relative(images);
        // Side files, as "1.jpg_original" of exiftool and raw photographs, may have an orientation, too.
        if (!has_image_extension(name)) {
            found.others.push_back(name);
            continue;
        }
        bool turned = false;
        try {
            const ImageInfo info = read_image_info(it->path());
            turned = info.orientation != 1;
            found.stored_sizes.insert({info.width, info.height});
            const bool quarter = is_quarter_turn(info.orientation);
            found.upright_sizes.insert({quarter ? info.height : info.width, quarter ? info.width : info.height});
            ++found.count;
        } catch (const DataError&) {
            // colmap skips what it cannot read, too.
        }
        (turned ? found.turned : found.others).push_back(name);
    }
    if (error) throw DataError(fmt::format("{}: cannot be read: {}", images.string(), error.message()));
    if (found.count == 0) throw DataError(fmt::format("{}: no photographs found", images.string()));
    return found;
}

/// Makes a link, or a copy on file systems without links (exFAT, network folders). Throws DataError.
void link_or_copy(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::create_symlink(fs::canonical(from), to, error);
    if (error) copy_file_atomic(from, to);
}

/// Writes the photographs into `folder` as they are to be looked at, because colmap ignores their EXIF orientation:
/// those that have one turned, the other files as links. Throws DataError, and Interrupted when the user stopped it.
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

/// Extracts "3/67" from "Processed file [3/67]"; empty when the line holds no such count.
std::string count_in(const std::string& line) {
    const auto open = line.find('['), slash = line.find('/', open);
    if (open == std::string::npos || slash == std::string::npos) return "";
    std::size_t end = slash + 1;
    while (end < line.size() && std::isdigit(static_cast<unsigned char>(line[end]))) ++end;
    const std::string count = line.substr(open + 1, end - open - 1);
    const bool digits_only = count.find_first_not_of("0123456789/") == std::string::npos;
    return digits_only && slash > open + 1 && end > slash + 1 ? count : "";
}

void run_stage(int stage, const std::string& name, const std::vector<std::string>& arguments,
               const PrepareProgress& progress) {
    progress(stage, kNumStages, name, "");
    std::vector<std::string> command = {"colmap"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    ProcessResult result;
    try {
        // Debian's colmap is linked with Qt and needs a display even for work without windows.
        result = run_process(command, {{"QT_QPA_PLATFORM", "offscreen"}}, [&](const std::string& line) {
            if (const std::string count = count_in(line); !count.empty()) progress(stage, kNumStages, name, count);
        });
    } catch (const UsageError& e) {
        throw UsageError(fmt::format("{}; install it with: apt-get install colmap", e.what()));
    }
    if (interrupted()) throw Interrupted(fmt::format("stopped during colmap's stage '{}'", name));
    if (result.exit_code == 0) return;
    throw DataError(fmt::format("colmap {} ended with exit code {}; its last lines:\n  {}", arguments[0],
                                result.exit_code, fmt::join(result.last_lines, "\n  ")));
}

/// Returns the number of images in a binary model, 0 when there is none.
std::uint64_t num_images(const fs::path& model) {
    std::ifstream file(model / "images.bin", std::ios::binary);
    unsigned char bytes[8] = {};
    if (!file.read(reinterpret_cast<char*>(bytes), 8)) return 0;
    std::uint64_t count = 0;
    for (int i = 7; i >= 0; --i) count = count << 8 | bytes[i];  // little endian in the file
    return count;
}

fs::path largest_model(const fs::path& models) {
    fs::path best;
    std::uint64_t most = 0;
    for (int i = 0; fs::exists(models / std::to_string(i)); ++i) {
        if (const auto n = num_images(models / std::to_string(i)); n > most)
            most = n, best = models / std::to_string(i);
    }
    if (most == 0)
        throw DataError("colmap found no camera positions; the photographs need more overlap, texture or sharpness");
    return best;
}

/// Keeps images/ and sparse/ of the output of image_undistorter, moves the model to sparse/0/ and deletes the rest.
void arrange(const fs::path& dense) {
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

/// Makes all that colmap wrote survive a power cut, and finds out what a full disk has kept from it.
void sync_scene(const fs::path& scene) {
    const int fd = ::open(scene.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const int error = fd >= 0 && ::syncfs(fd) == 0 ? 0 : errno;
    if (fd >= 0) ::close(fd);
    if (error != 0) fail_to_write("write", scene, error);
}

/// Puts the new scene in the place of an earlier one, which is removed only then, and put back if that fails.
void put_in_place(const fs::path& scene, const fs::path& target) {
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

}  // namespace

void prepare_scene(const PrepareOptions& options, const PrepareProgress& progress) {
    if (options.matcher != "exhaustive" && options.matcher != "sequential")
        throw UsageError(fmt::format("--matcher: '{}' is not one of exhaustive, sequential", options.matcher));
    check_target(options);
    const Photographs photographs = find_photographs(options.images);
    const bool turn = photographs.should_turn();
    const char* single_camera = (turn ? photographs.upright_sizes : photographs.stored_sizes).size() == 1 ? "1" : "0";
    const char* gpu = options.gpu ? "1" : "0";
    const fs::path target = options.scene.has_filename() ? options.scene : options.scene.parent_path();
    const WorkFolder work(target);
    const std::string database = (work.path() / "database.db").string();
    const std::string images = (turn ? work.path() / "upright" : options.images).string();
    const fs::path models = work.path() / "models", dense = work.path() / "dense";
    try {
        fs::create_directories(models);
        if (turn) {
            log_info("{} of {} photographs have an EXIF orientation, which colmap ignores: it gets upright copies",
                     photographs.turned.size(), photographs.count);
            write_upright(options.images, photographs, images);
        } else if (!photographs.turned.empty()) {
            log_warning(
                "{} of {} photographs have an EXIF orientation, which colmap ignores: they stay on their side, so "
                "that all share one camera; only the pictures of the run look turned",
                photographs.turned.size(), photographs.count);
        }
        run_stage(
            1, "features",
            {"feature_extractor", "--database_path", database, "--image_path", images, "--ImageReader.camera_model",
             options.camera_model, "--ImageReader.single_camera", single_camera, "--SiftExtraction.use_gpu", gpu},
            progress);
        run_stage(2, "matches",
                  {options.matcher + "_matcher", "--database_path", database, "--SiftMatching.use_gpu", gpu}, progress);
        run_stage(3, "cameras",
                  {"mapper", "--database_path", database, "--image_path", images, "--output_path", models.string()},
                  progress);
        run_stage(4, "undistortion",
                  {"image_undistorter", "--image_path", images, "--input_path", largest_model(models).string(),
                   "--output_path", dense.string(), "--output_type", "COLMAP"},
                  progress);
        arrange(dense);
        sync_scene(dense);
        put_in_place(dense, target);
    } catch (const fs::filesystem_error& e) {
        const fs::path& path = e.path2().empty() ? e.path1() : e.path2();  // of a rename the target
        throw DataError(fmt::format("{}: {}", path.string(), e.code().message()));
    }
}

}  // namespace gs
