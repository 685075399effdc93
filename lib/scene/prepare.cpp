// SPDX-License-Identifier: Apache-2.0
// Runs colmap's four stages, for a video after extracting its frames, and reports the result.
#include "lib/scene/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <set>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"
#include "lib/core/process.h"
#include "lib/io/atomic_file.h"
#include "lib/io/temporary.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/matching.h"
#include "lib/scene/panorama.h"
#include "lib/scene/photographs.h"
#include "lib/scene/prepared_folder.h"
#include "lib/scene/programs.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr double kDefaultFps = 2;
constexpr const char* kLog = "colmap.log";

bool is_video(const fs::path& source) { return path_exists(source) && !folder_exists(source); }

void check_options(const PrepareOptions& options) {
    const std::set<std::string> matchings = {"auto", "exhaustive", "sequential", "vocab-tree"};
    if (!matchings.contains(options.matching))
        throw UsageError(
            fmt::format("--matching: '{}' is not one of {}", options.matching, fmt::join(matchings, ", ")));
    if (!options.fps) return;
    if (!is_video(options.source)) throw UsageError("--fps is for a video");
    if (!(*options.fps >= 0.01 && *options.fps <= 60))
        throw UsageError(fmt::format("--fps is {:g}; must be from 0.01 to 60", *options.fps));
}

/// Returns the number of images in a binary model, or 0 if there is none.
std::uint64_t num_images(const fs::path& model) {
    std::ifstream file(model / "images.bin", std::ios::binary);
    unsigned char bytes[8] = {};
    if (!file.read(reinterpret_cast<char*>(bytes), 8)) return 0;
    std::uint64_t count = 0;
    for (int i = 7; i >= 0; --i) count = count << 8 | bytes[i];  // little endian in the file
    return count;
}

/// The work of one call of prepare_scene.
class Preparation {
  public:
    Preparation(const PrepareOptions& options, const PrepareProgress& progress, const fs::path& work, ProgramLog& log)
        : options_(options), show_(progress), work_(work), log_(log) {
        report_.is_video = is_video(options.source);
        report_.is_panorama = options.is_panorama();
    }

    /// Makes the scene in the folder `dense()` and returns the report.
    PrepareReport run() {
        Photographs photographs;
        if (!report_.is_video) photographs = find_photographs(options_.source);
        // Chosen first, so that an error in this choice does not appear after an hour.
        use_gpu_ = choose_gpu();
        const Matching matching = choose_matching(options_, photographs.names, report_.is_video, program_);
        log_info("matching: {}", matching.words);
        const fs::path given = report_.is_video ? take_frames() : options_.source;
        if (report_.is_video) photographs = find_photographs(given);
        report_.photographs = photographs.names.size();
        report_.notes = photographs.notes;
        images_ = provide_upright(given, photographs).string();
        const std::string panoramas = images_;
        if (report_.is_panorama) provide_faces(photographs);
        extract_features(photographs);
        match(matching);
        const fs::path model = reconstruct();
        if (report_.is_panorama)
            keep_panoramas(model, panoramas);
        else
            undistort(model);
        read_report(photographs);
        return std::move(report_);
    }
    fs::path dense() const { return work_ / "dense"; }

  private:
    /// Begins the next stage.
    void begin(const std::string& name) {
        stage_name_ = name;
        ++stage_;
        show("");
    }
    void show(const std::string& count) const { show_(stage_, report_.is_video ? 5 : 4, stage_name_, count); }
    void show(const StageCount& count) const {
        show(count.total > 0 ? fmt::format("{}/{}", count.done, count.total) : std::to_string(count.done));
    }

    void colmap(std::vector<std::string> arguments, const std::function<void(const std::string&)>& on_line) {
        const std::string name = "colmap " + arguments[0];
        arguments.insert(arguments.begin(), "colmap");
        log_.run(name, arguments, on_line);
    }
    void colmap(std::vector<std::string> arguments) {
        colmap(std::move(arguments), [this](const std::string& line) {
            if (const auto count = count_in(line)) show(*count);
        });
    }

    fs::path take_frames() {
        begin("frames");
        const fs::path frames = work_ / "frames";
        extract_frames(options_.source, options_.fps.value_or(kDefaultFps), frames, log_,
                       [this](std::int64_t done, std::int64_t total) {
                           show(StageCount{done, total});
                       });
        return frames;
    }

    /// Returns the folder of photographs for colmap: the given folder, or a copy of it if some photographs must be
    /// turned upright or some files are masks.
    fs::path provide_upright(const fs::path& given, const Photographs& photographs) {
        const std::size_t turned = photographs.turned.size(), all = photographs.names.size();
        if (!photographs.masks.empty())
            log_warning("{} masks beside the photographs ({}, ...) are not given to colmap, and the scene has none",
                        photographs.masks.size(), photographs.masks[0]);
        turns_ = photographs.should_turn();
        if (turns_) {
            log_info("{} of {} photographs have an EXIF orientation, which colmap ignores: it gets upright copies",
                     turned, all);
            write_upright(given, photographs, work_ / "upright");
            return work_ / "upright";
        }
        if (turned > 0)
            log_warning(
                "{} of {} photographs have an EXIF orientation, which colmap ignores: they stay on their side, so "
                "that all share one camera; only the pictures of the run look turned",
                turned, all);
        if (photographs.masks.empty()) return given;
        Photographs as_stored = photographs;
        as_stored.others.insert(as_stored.others.end(), as_stored.turned.begin(), as_stored.turned.end());
        as_stored.turned.clear();
        write_upright(given, as_stored, work_ / "photographs");
        return work_ / "photographs";
    }

    /// Writes the faces that colmap sees in place of the panoramas.
    void provide_faces(const Photographs& photographs) {
        begin("faces");
        const fs::path faces = work_ / "faces";
        face_parameters_ = write_faces(images_, photographs.names, faces, [&](std::size_t done, std::size_t all) {
            show(StageCount{std::int64_t(done), std::int64_t(all)});
        });
        images_ = faces.string();
    }

    /// Returns the option of `command` that selects the GPU or the CPU, with its value.
    std::vector<std::string> gpu_choice(const std::string& command) {
        const std::string option = program_.option(command, "use_gpu");
        if (option.empty()) return {};
        return {option, use_gpu_ ? "1" : "0"};
    }
    bool choose_gpu() const {
        const bool asked = options_.gpu.value_or(false);
        if (!program_.has_cuda()) {
            if (asked) throw UsageError(fmt::format("--gpu: this {} was built without CUDA", program_.version()));
            log_info("{} without CUDA: features and matches are computed on the CPU", program_.version());
            return false;
        }
        const bool chosen = options_.gpu ? asked : has_nvidia_gpu();
        log_info("{} computes features and matches on the {}", program_.version(), chosen ? "GPU" : "CPU");
        return chosen;
    }
    static bool has_nvidia_gpu() {
        try {
            return run_process({"nvidia-smi", "-L"}, {}, [](const std::string&) {}).exit_code == 0;
        } catch (const UsageError&) {  // nvidia-smi, which comes with the driver, is not installed
            return false;
        }
    }

    void extract_features(const Photographs& photographs) {
        const auto& sizes = turns_ ? photographs.upright_sizes : photographs.stored_sizes;
        std::string model = options_.camera_model;
        bool one_camera = sizes.size() == 1;
        if (report_.is_panorama) model = "SIMPLE_PINHOLE", one_camera = true;
        std::vector<std::string> arguments = {"feature_extractor",
                                              "--database_path",
                                              database(),
                                              "--image_path",
                                              images_,
                                              "--ImageReader.camera_model",
                                              model,
                                              "--ImageReader.single_camera",
                                              one_camera ? "1" : "0"};
        if (report_.is_panorama) arguments.insert(arguments.end(), {"--ImageReader.camera_params", face_parameters_});
        for (std::string& word : gpu_choice("feature_extractor")) arguments.push_back(std::move(word));
        begin("features");
        colmap(std::move(arguments));
    }

    void match(const Matching& matching) {
        begin("matching");
        std::vector<std::string> arguments = {matching.command, "--database_path", database()};
        arguments.insert(arguments.end(), matching.arguments.begin(), matching.arguments.end());
        for (std::string& word : gpu_choice(matching.command)) arguments.push_back(std::move(word));
        colmap(std::move(arguments));
    }

    /// Returns the reconstruction with the most photographs. Throws DataError if there is none.
    fs::path reconstruct() {
        const fs::path models = work_ / "models";
        fs::create_directories(models);
        begin("registered");
        bool finds_nothing = false;
        std::vector<std::string> arguments = {"mapper", "--database_path", database(),     "--image_path",
                                              images_,  "--output_path",   models.string()};
        // The faces' focal length is known.
        if (report_.is_panorama) arguments.insert(arguments.end(), {"--Mapper.ba_refine_focal_length", "0"});
        try {
            colmap(std::move(arguments), [&](const std::string& line) {
                if (const auto count = registered_in(line))
                    show(StageCount{count->done,
                                    std::int64_t(report_.photographs) * (report_.is_panorama ? kPanoramaFaces : 1)});
                finds_nothing |= line.find("failed to create sparse model") != std::string::npos;
            });
        } catch (const DataError&) {
            if (!finds_nothing) throw;  // otherwise colmap finished its work, and the message below is better
        }
        std::vector<std::pair<std::uint64_t, fs::path>> found;
        for (int i = 0; fs::exists(models / std::to_string(i)); ++i)
            if (const auto n = num_images(models / std::to_string(i))) found.push_back({n, models / std::to_string(i)});
        std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
        if (found.empty())
            throw DataError(
                "colmap found no camera positions; the photographs need more overlap, texture or sharpness");
        for (std::size_t i = 1; i < found.size(); ++i) report_.other_models.push_back(std::size_t(found[i].first));
        try {
            colmap({"model_analyzer", "--path", found[0].second.string()}, [this](const std::string& line) {
                if (const auto error = reprojection_error_in(line)) report_.error = error;
            });
        } catch (const DataError&) {  // the log shows why the value is missing
        }
        return found[0].second;
    }

    void undistort(const fs::path& model) {
        begin("undistorted");
        colmap({"image_undistorter", "--image_path", images_, "--input_path", model.string(), "--output_path",
                dense().string(), "--output_type", "COLMAP"});
        arrange_scene(dense());
    }

    /// Makes the scene from the panoramas, with the cameras that follow from those of their faces.
    void keep_panoramas(const fs::path& model, const fs::path& images) {
        const PanoramaModel found = write_panorama_model(read_colmap_model(model), images, dense() / "sparse" / "0");
        for (const std::string& name : found.panoramas) copy_file_atomic(images / name, dense() / "images" / name);
        if (found.disagreement)
            report_.notes.push_back(
                fmt::format("the faces of a 360-degree photograph differ by {:.2g} degrees from its camera (median)",
                            *found.disagreement));
        if (!found.contradictory.empty())
            report_.notes.push_back(
                fmt::format("faces that differ from the others by more than 5 degrees were left out; check the cameras "
                            "of {}",
                            fmt::join(found.contradictory, ", ")));
    }

    void read_report(const Photographs& photographs) {
        const ColmapModel model = read_colmap_model(dense() / "sparse" / "0");
        report_.registered = model.images.size();
        report_.points = model.points.positions.size();
        std::set<std::string> registered;
        for (const ColmapImage& image : model.images) registered.insert(image.name);
        std::set_difference(photographs.names.begin(), photographs.names.end(), registered.begin(), registered.end(),
                            std::back_inserter(report_.left_out));
    }

    std::string database() const { return (work_ / "database.db").string(); }

    const PrepareOptions& options_;
    const PrepareProgress& show_;
    fs::path work_;
    ProgramLog& log_;
    ColmapProgram program_;
    PrepareReport report_;
    std::string images_, stage_name_;
    std::string face_parameters_;  ///< of the pinhole of panoramas' faces
    int stage_ = 0;
    bool turns_ = false, use_gpu_ = false;
};

/// Returns "12,345" for 12345.
std::string grouped(std::size_t n) {
    std::string digits = std::to_string(n);
    for (std::size_t i = digits.size(); i > 3; i -= 3) digits.insert(i - 3, ",");
    return digits;
}

}  // namespace

PrepareReport prepare_scene(const PrepareOptions& options, const PrepareProgress& progress) {
    check_options(options);
    check_target(options.source, options.scene, options.overwrite);
    const fs::path target = options.scene.has_filename() ? options.scene : options.scene.parent_path();
    const WorkFolder work(target);
    ProgramLog log(work.path() / kLog);
    try {
        Preparation preparation(options, progress, work.path(), log);
        PrepareReport report = preparation.run();
        fs::rename(log.path(), preparation.dense() / kLog);
        put_in_place(preparation.dense(), target);
        report.log = target / kLog;
        return report;
    } catch (const fs::filesystem_error& e) {
        const fs::path& path = e.path2().empty() ? e.path1() : e.path2();  // the target of a rename
        throw DataError(fmt::format("{}: {}", path.string(), e.code().message()));
    } catch (const DataError& e) {
        throw DataError(e.what() + (log.has_runs() ? keep_failed_log(log.path(), target) : ""));
    }
}

std::vector<std::string> describe(const PrepareReport& report) {
    constexpr std::size_t kShown = 10;
    constexpr double kExactPixels = 1;  // of scenes whose given poses are as good as learned ones: 0.5 and 0.7
    const char* what = report.is_video ? "frames" : "photographs";
    std::vector<std::string> lines = {fmt::format("{} of {} {} registered, {} points", report.registered,
                                                  report.photographs, what, grouped(report.points))};
    if (report.error) lines[0] += fmt::format(", mean reprojection error {:.2g} px", *report.error);
    if (report.error && *report.error > kExactPixels)
        lines.push_back("cameras may be off: gsapp train --refine-cameras auto finds out whether learning them helps");
    if (const auto& names = report.left_out; !names.empty()) {
        const std::vector<std::string> shown(names.begin(),
                                             names.begin() + std::ptrdiff_t(std::min(names.size(), kShown)));
        lines.push_back(fmt::format("left out: {}", fmt::join(shown, ", ")));
        if (names.size() > kShown) lines.back() += fmt::format(" and {} more", names.size() - kShown);
    }
    if (!report.other_models.empty())
        lines.push_back(fmt::format(
            "colmap made {} reconstructions that do not connect: the largest is the scene; the others hold "
            "{} {}",
            report.other_models.size() + 1, fmt::join(report.other_models, ", "), report.is_panorama ? "faces" : what));
    lines.insert(lines.end(), report.notes.begin(), report.notes.end());
    return lines;
}

bool is_poor(const PrepareReport& report) { return report.registered * 10 < report.photographs * 9; }

}  // namespace gs
