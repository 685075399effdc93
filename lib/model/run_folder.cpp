// SPDX-License-Identifier: Apache-2.0
// Computes the paths of a run folder, locks it with flock, protects earlier results and writes small files.
#include "lib/model/run_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <string_view>
#include <vector>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/core/utf8.h"
#include "lib/io/atomic_file.h"
#include "lib/io/ply_file.h"
#include "lib/io/temporary.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/checkpoint.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

constexpr const char* kLockName = ".gsapp.lock";

bool same_file(const struct stat& a, const struct stat& b) { return a.st_dev == b.st_dev && a.st_ino == b.st_ino; }

/// Returns the holder of the lock, " (process 123)"; empty if the file does not name it.
std::string holder(int fd) {
    char digits[24] = {};
    const ssize_t size = ::pread(fd, digits, sizeof digits - 1, 0);
    const std::string text(digits, size > 0 ? std::size_t(size) : 0);
    const std::string pid = text.substr(0, text.find_first_not_of("0123456789"));
    return pid.empty() ? "" : " (process " + pid + ")";
}

namespace fs = std::filesystem;

/// Returns the number in "<prefix>N<suffix>"; nothing if the name has another form.
std::optional<std::int64_t> numbered(const fs::path& path, std::string_view prefix, std::string_view suffix) {
    const std::string name = path.filename().string();
    std::int64_t value = 0;
    if (name.size() <= prefix.size() + suffix.size() || !name.starts_with(prefix) || !name.ends_with(suffix))
        return std::nullopt;
    const char* const first = name.data() + prefix.size();
    const char* const last = name.data() + name.size() - suffix.size();
    const auto [end, error] = std::from_chars(first, last, value);
    if (error != std::errc() || end != last || *first == '-') return std::nullopt;
    return value;
}

struct NumberedFile {
    std::int64_t number;
    fs::path path;
};

/// Lists the entries "<prefix>N<suffix>" of a folder, ascending by N; none if the folder does not exist.
std::vector<NumberedFile> list_numbered(const fs::path& folder, std::string_view prefix, std::string_view suffix) {
    std::vector<NumberedFile> found;
    if (!folder_exists(folder)) return found;
    for (const fs::path& path : list_folder(folder)) {
        if (const auto n = numbered(path, prefix, suffix)) found.push_back({*n, path});
    }
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.number < b.number; });
    return found;
}

std::vector<NumberedFile> point_clouds(const fs::path& root) {
    return list_numbered(root / "point_cloud", "iteration_", "");
}
std::vector<NumberedFile> checkpoints(const fs::path& root) {
    return list_numbered(root / "checkpoints", "iteration_", ".safetensors");
}

void remove_file(const fs::path& path) {
    std::error_code error;
    fs::remove(path, error);
    if (error) throw DataError(fmt::format("cannot remove '{}' of an earlier run: {}", path.string(), error.message()));
}

/// Removes a folder if it is empty.
void remove_if_empty(const fs::path& folder) {
    std::error_code error;
    if (fs::is_empty(folder, error) && !error) fs::remove(folder, error);
}

/// Removes the files that gsapp wrote for iterations above `after`.
void remove_iterations(const RunFolder& folder, std::int64_t after) {
    for (const auto& [n, path] : point_clouds(folder.root)) {
        if (n <= after) continue;
        remove_file(path / "point_cloud.ply");
        remove_if_empty(path);
    }
    for (const auto& [n, path] : checkpoints(folder.root)) {
        if (n > after) remove_file(path);
    }
    for (const auto& [n, path] : list_numbered(folder.root / "preview", "", ".png")) {
        if (n > after) remove_file(path);
    }
    for (const char* split : {"test", "train"}) {
        for (const auto& [n, path] : list_numbered(folder.root / split, "ours_", "")) {
            if (n <= after) continue;
            for (const char* kind : {"renders", "gt", "base", "residual"}) {
                for (const auto& [index, image] : list_numbered(path / kind, "", ".png")) remove_file(image);
                remove_if_empty(path / kind);
            }
            remove_if_empty(path);
        }
        remove_if_empty(folder.root / split);
    }
    for (const char* name : {"point_cloud", "checkpoints", "preview"}) remove_if_empty(folder.root / name);
}

/// Removes the files of write_refined_scene(), and the pictures beside it.
void remove_refined_scene(const RunFolder& folder) {
    const fs::path refined = folder.refined_scene(), model = refined / "sparse" / "0";
    for (const char* name : {"cameras.txt", "images.txt", "points3D.txt", "test.txt"}) remove_file(model / name);
    remove_file(refined / "transforms.json");
    for (std::size_t rank = 0; rank < RunFolder::kCorrections; ++rank) remove_file(folder.correction(rank));
    std::error_code error;
    if (fs::is_symlink(refined / "images", error)) fs::remove(refined / "images", error);
    for (const fs::path& path : {model, refined / "sparse", refined / "corrections", refined}) remove_if_empty(path);
}

/// Removes the temporary files of killed runs from the folders that runs write to.
void remove_leftovers_of_runs(const RunFolder& folder) {
    std::vector<fs::path> folders = {folder.root};
    for (const char* name : {"point_cloud", "checkpoints", "preview", "stats", "test", "train", "renders", "refined"}) {
        folders.push_back(folder.root / name);
        std::error_code error;
        for (fs::recursive_directory_iterator it(folders.back(), error), end; !error && it != end; it.increment(error))
            if (it->is_directory(error) && !it->is_symlink(error)) folders.push_back(it->path());
    }
    for (const fs::path& path : folders) remove_leftovers(path);
}

/// Returns the text as a Python string literal. Bytes that are not UTF-8 are written as in Python's own representation
/// of such names (surrogateescape).
std::string quoted(const std::string& text) {
    const bool utf8 = is_utf8(text);
    std::string out = "'";
    for (const char c : text) {
        if (c == '\\' || c == '\'') out += '\\';
        if (c == '\n') {
            out += "\\n";
        } else if (!utf8 && static_cast<unsigned char>(c) >= 0x80) {
            out += fmt::format("\\udc{:02x}", static_cast<unsigned char>(c));
        } else {
            out += c;
        }
    }
    return out + "'";
}

/// Returns whether config.yaml was written by gsapp, i.e. begins with the name of the program.
bool holds_run(const RunFolder& folder) {
    constexpr std::string_view kBeginning = "# gsapp ";
    std::string beginning(kBeginning.size(), '\0');
    return input_fault(folder.config()).empty() &&
           open_input(folder.config()).read(beginning.data(), std::streamsize(beginning.size())) &&
           beginning == kBeginning;
}

/// Returns whether a run may begin beside this entry of its folder: a hidden file, which holds no results; an empty
/// file, which a shell creates for redirected output; or a file of a run that was killed before writing config.yaml.
bool is_of_no_account(const RunFolder& folder, const fs::path& entry) {
    std::error_code error;
    const std::string name = entry.filename().string(), log = "gsapp.log";
    if (name.starts_with('.') || name == log) return true;
    if (entry == folder.appearance_choice()) return path_exists(folder.root / log);
    return fs::is_regular_file(entry, error) && fs::file_size(entry, error) == 0 && !error;
}

/// Returns the first existing file or folder with a name that a run writes; empty if there is none.
fs::path taken_name(const RunFolder& folder) {
    for (const fs::path& path : {folder.config(), folder.cfg_args(), folder.cameras(), folder.input_points(),
                                 folder.results(), folder.per_view(), folder.ppisp(), folder.train_log(),
                                 folder.root / "comparison.png", folder.refined_scene()})
        if (path_exists(path)) return path;
    if (path_exists(folder.appearance_choice()) && !is_of_no_account(folder, folder.appearance_choice()))
        return folder.appearance_choice();
    for (const auto& found :
         {point_clouds(folder.root), checkpoints(folder.root), list_numbered(folder.root / "preview", "", ".png"),
          list_numbered(folder.root / "test", "ours_", ""), list_numbered(folder.root / "train", "ours_", "")})
        if (!found.empty()) return found.front().path;
    return {};
}

/// Throws UsageError for a folder without a run, unless it is empty, or `overwrite` is set and nothing would be
/// replaced.
void require_own_names(const RunFolder& folder, bool overwrite) {
    if (!folder_exists(folder.root)) return;
    if (const fs::path taken = taken_name(folder); !taken.empty())
        throw UsageError(fmt::format(
            "the run would replace '{}', which is not of a run of gsapp (its folder has no config.yaml that "
            "gsapp wrote); --overwrite replaces runs alone: choose another --model folder",
            taken.string()));
    if (overwrite) return;
    for (const fs::path& entry : list_folder(folder.root))
        if (!is_of_no_account(folder, entry))
            throw UsageError(
                fmt::format("the output folder '{}' is not empty and holds no run ('{}' is there); choose "
                            "another --model folder, or give --overwrite to train beside what is there",
                            folder.root.string(), entry.filename().string()));
}

fs::path view_image(const fs::path& root, const std::string& split, std::int64_t iteration, const std::string& kind,
                    int index) {
    return root / split / fmt::format("ours_{}", iteration) / kind / fmt::format("{:05}.png", index);
}

}  // namespace

RunLock::RunLock(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::error_code error;
    std::filesystem::create_directories(folder_, error);
    if (error)
        throw DataError(fmt::format("cannot create the output folder '{}': {}", folder_.string(), error.message()));
    folder_fd_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder_fd_ < 0)
        throw DataError(fmt::format("cannot open the output folder '{}': {}", folder_.string(), std::strerror(errno)));
    try {
        lock_file();
    } catch (...) {
        if (file_fd_ >= 0) ::close(file_fd_);
        ::close(folder_fd_);
        throw;
    }
}

void RunLock::lock_file() {
    for (;;) {
        file_fd_ = ::openat(folder_fd_, kLockName, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        if (file_fd_ < 0)
            throw DataError(
                fmt::format("cannot write in the output folder '{}': {}; choose an output folder you may "
                            "write to",
                            folder_.string(), std::strerror(errno)));
        int result = 0;
        do {
            result = ::flock(file_fd_, LOCK_EX | LOCK_NB);
        } while (result != 0 && errno == EINTR);
        if (result != 0 && errno == EWOULDBLOCK)
            throw UsageError(
                fmt::format("another run{} writes into the output folder '{}'; choose another --model "
                            "folder, or wait until that run has ended",
                            holder(file_fd_), folder_.string()));
        if (result != 0)
            log_warning("'{}' cannot be locked ({}): make sure that no other run writes into it", folder_.string(),
                        std::strerror(errno));
        // A run that ended between open and flock has removed the now locked file; the next lock file is another one.
        struct stat locked {
        }, named{};
        if (::fstat(file_fd_, &locked) == 0 && ::fstatat(folder_fd_, kLockName, &named, 0) == 0 &&
            same_file(locked, named))
            break;
        ::close(file_fd_);
    }
    const std::string pid = std::to_string(::getpid()) + "\n";
    // The process id serves only messages, so a failed write is ignored; on a full disk the writers of results report
    // it.
    if (::ftruncate(file_fd_, 0) != 0 || ::pwrite(file_fd_, pid.data(), pid.size(), 0) < 0) errno = 0;
}

RunLock::~RunLock() {
    ::unlinkat(folder_fd_, kLockName, 0);
    ::close(file_fd_);
    ::close(folder_fd_);
}

bool RunLock::is_held(const std::filesystem::path& folder) {
    const int fd = ::open((folder / kLockName).c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return false;
    const bool held = ::flock(fd, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    ::close(fd);
    return held;
}

void RunLock::check_folder() const {
    struct stat locked {
    }, named{};
    if (::fstat(folder_fd_, &locked) == 0 && ::stat(folder_.c_str(), &named) == 0 && same_file(locked, named)) return;
    throw DataError(
        fmt::format("the output folder '{}' was removed or replaced while the run wrote to it", folder_.string()));
}

fs::path RunFolder::point_cloud(std::int64_t iteration) const {
    return root / "point_cloud" / fmt::format("iteration_{}", iteration) / "point_cloud.ply";
}

fs::path RunFolder::checkpoint(std::int64_t iteration) const {
    return root / "checkpoints" / fmt::format("iteration_{}.safetensors", iteration);
}

fs::path RunFolder::correction(std::size_t rank) const {
    return refined_scene() / "corrections" / fmt::format("{}.jpg", rank);
}

fs::path RunFolder::preview(std::int64_t iteration) const {
    return root / "preview" / fmt::format("{:06}.png", iteration);
}

fs::path RunFolder::render(const std::string& split, std::int64_t iteration, int index) const {
    return view_image(root, split, iteration, "renders", index);
}

fs::path RunFolder::ground_truth(const std::string& split, std::int64_t iteration, int index) const {
    return view_image(root, split, iteration, "gt", index);
}

fs::path RunFolder::picture_part(const std::string& split, std::int64_t iteration, const std::string& part,
                                 int index) const {
    return view_image(root, split, iteration, part, index);
}

void require_free_run_folder(const RunFolder& folder, bool overwrite, std::optional<std::int64_t> resume_iteration) {
    const std::int64_t after = resume_iteration.value_or(-1);
    // A killed run may have saved point clouds after its last checkpoint. The resumed run writes them again.
    const bool own = resume_iteration && path_exists(folder.checkpoint(after));
    if (!own && !holds_run(folder)) return require_own_names(folder, overwrite);
    if (overwrite) return;
    const auto saved = checkpoints(folder.root), clouds = point_clouds(folder.root);
    std::int64_t latest = saved.empty() ? -1 : saved.back().number;
    if (!own && !clouds.empty()) latest = std::max(latest, clouds.back().number);
    if (resume_iteration && latest <= after) return;
    if (saved.empty() && !resume_iteration)
        throw UsageError(fmt::format(
            "the output folder '{}' already holds a run{}, which has no checkpoint to resume; choose another "
            "--model folder, or give --overwrite to start anew",
            folder.root.string(), latest >= 0 ? fmt::format(" up to iteration {}", latest) : ""));
    const std::string holds = fmt::format("a run up to iteration {}", latest);
    throw UsageError(resume_iteration ? fmt::format("the output folder '{}' holds {}, later than the resumed "
                                                    "iteration {}; choose another --model folder, or "
                                                    "give --overwrite to drop the later results",
                                                    folder.root.string(), holds, after)
                                      : fmt::format("the output folder '{}' already holds {}; choose another "
                                                    "--model folder, --resume it, or give --overwrite",
                                                    folder.root.string(), holds));
}

void prepare_run_folder(const RunFolder& folder, bool overwrite, std::optional<std::int64_t> resume_iteration) {
    std::error_code error;
    fs::create_directories(folder.root, error);
    if (error)
        throw DataError(fmt::format("cannot create the output folder '{}': {}", folder.root.string(), error.message()));
    remove_leftovers_of_runs(folder);
    AtomicFile probe(folder.config());  // never committed; only tests that files can be created here
    require_free_run_folder(folder, overwrite, resume_iteration);
}

void replace_earlier_run(const RunFolder& folder, const std::string& config,
                         std::optional<std::int64_t> resume_iteration) {
    write_text_atomic(folder.config(), config);
    remove_iterations(folder, resume_iteration.value_or(-1));
    remove_file(folder.ppisp());  // written at the end of a run, as are these cameras
    remove_refined_scene(folder);
    if (resume_iteration) return;
    for (const auto& path : {folder.cfg_args(), folder.cameras(), folder.input_points(), folder.results(),
                             folder.per_view(), folder.appearance_choice(), folder.train_log()}) {
        remove_file(path);
    }
    remove_if_empty(folder.train_log().parent_path());
}

namespace {

/// Returns the reason why a run folder has no checkpoint, with advice; empty if the folder has no config.yaml.
std::string why_no_checkpoint(const fs::path& run_folder) {
    if (!path_exists(RunFolder{run_folder}.config())) return "";
    const char* const killed =
        ": its run ended before the first checkpoint; start it anew with --overwrite in place of --resume";
    if (point_clouds(run_folder).empty()) return killed;
    TrainOptions options;
    try {
        options = load_run_options(run_folder);
    } catch (const Error&) {  // not a config.yaml of gsapp
        return killed;
    }
    options.model = run_folder.string();
    if (options.time_limit)
        return ": its run ended before the first checkpoint or is complete, and under a time limit no checkpoint is "
               "written at the end; train anew with --overwrite in place of --resume";
    if (options.ends_by_iterations() && ended_at(options))
        return ": its run is complete, but its checkpoints are gone; train anew with --overwrite, or begin another run "
               "with its Gaussians (--init)";
    return killed;
}

}  // namespace

fs::path latest_checkpoint(const fs::path& run_folder) {
    const auto found = checkpoints(run_folder);
    if (found.empty()) {
        const std::string why = why_no_checkpoint(run_folder);
        throw DataError(fmt::format("'{}' holds no checkpoints/iteration_N.safetensors to resume from{}",
                                    run_folder.string(), why));
    }
    return found.back().path;
}

void remove_automatic_checkpoints(const RunFolder& folder, std::int64_t iteration) {
    for (const auto& [n, path] : checkpoints(folder.root)) {
        std::error_code error;
        if (n >= iteration || !is_automatic_checkpoint(path)) continue;
        fs::remove(path, error);
        if (error) log_warning("cannot remove the earlier checkpoint '{}': {}", path.string(), error.message());
    }
}

std::int64_t latest_point_cloud(const fs::path& run_folder) {
    const auto found = point_clouds(run_folder);
    if (found.empty())
        throw DataError(fmt::format("'{}' holds no point_cloud/iteration_N; is it the output folder of a finished run?",
                                    run_folder.string()));
    return found.back().number;
}

std::optional<std::int64_t> latest_saved(const fs::path& run_folder) {
    std::optional<std::int64_t> latest;
    for (const auto& found : {point_clouds(run_folder), checkpoints(run_folder)})
        if (!found.empty()) latest = std::max(latest.value_or(0), found.back().number);
    return latest;
}

std::string cfg_args(const RunFolder& folder, const TrainOptions& options) {
    const auto flag = [](bool value) { return value ? "True" : "False"; };
    return fmt::format(
        "Namespace(data_device='cuda', eval={}, images={}, model_path={}, resolution={}, sh_degree={}, "
        "source_path={}, white_background={})",
        flag(options.eval), quoted(options.images), quoted(absolute_path(folder.root.string())),
        options.resolution.value_or(-1),
        appearance_model(options.appearance).plain_sh ? appearance_spec(options).max_degree : 0,
        quoted(absolute_path(options.source)), flag(options.background.always(1, 1, 1)));
}

void write_input_points(const RunFolder& folder, const PointCloud& points, const Frame& frame) {
    PlyHeader header;
    header.count = std::int64_t(points.positions.size());
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) header.properties.push_back({name, PlyType::kFloat});
    for (const char* name : {"red", "green", "blue"}) header.properties.push_back({name, PlyType::kUint8});
    const FileCoordinates coordinates{frame, file_offset(frame)};
    if (!coordinates.offset.isZero(0)) header.comments.push_back(offset_comment(coordinates.offset));
    AtomicFile file(folder.input_points());
    write_ply_header(file.stream(), header);
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        char row[27] = {};
        for (int axis = 0; axis < 3; ++axis) {
            const float x = float(coordinates.to_file(points.positions[i][axis], axis));
            std::memcpy(row + 4 * axis, &x, 4);
        }
        for (int c = 0; c < 3; ++c) {
            const float color = std::clamp(points.colors[i][c], 0.0f, 1.0f);
            row[24 + c] = char(static_cast<unsigned char>(color * 255.0f + 0.5f));
        }
        file.stream().write(row, sizeof row);
    }
    file.commit();
}

std::optional<std::int64_t> ended_at(const TrainOptions& options) {
    try {
        const std::int64_t last = options.ends_by_iterations() ? options.iterations : latest_point_cloud(options.model);
        if (path_exists(RunFolder{options.model}.point_cloud(last))) return last;
    } catch (const DataError&) {  // no point cloud yet
    }
    return std::nullopt;
}

}  // namespace gs
