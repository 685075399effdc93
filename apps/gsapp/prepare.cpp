// SPDX-License-Identifier: Apache-2.0
// gsapp prepare: converts photographs or a video to a scene, with colmap.
#include "lib/scene/prepare.h"

#include <unistd.h>

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"

namespace gs {
namespace {

/// A progress line on a terminal; elsewhere one message per stage.
class StageLine {
  public:
    void show(int stage, int stages, const std::string& name, const std::string& count) {
        if (::isatty(STDERR_FILENO) == 1) {
            if (stage != shown_) finish();
            std::fprintf(stderr, "\r\033[K[%d/%d] %s %s", stage, stages, name.c_str(), count.c_str());
            std::fflush(stderr);
            open_ = true;
        } else if (stage != shown_) {
            log_info("[{}/{}] {}", stage, stages, name);
        }
        shown_ = stage;
    }
    void finish() {
        if (open_) std::fputs("\n", stderr);
        open_ = false;
    }
    ~StageLine() { finish(); }

  private:
    int shown_ = 0;
    bool open_ = false;
};

nlohmann::ordered_json json_of(const PrepareReport& report, const std::filesystem::path& scene) {
    nlohmann::ordered_json json = {{"scene", scene.string()},
                                   {"photographs", report.photographs},
                                   {"registered", report.registered},
                                   {"points", report.points}};
    json["mean_reprojection_error"] = report.error ? nlohmann::ordered_json(*report.error) : nlohmann::ordered_json();
    json["left_out"] = report.left_out;
    json["other_models"] = report.other_models;
    json["log"] = report.log.string();
    return json;
}

void run_prepare(const PrepareOptions& options, bool json, bool quiet) {
    catch_interrupts();  // the child processes receive the signal as well; the temporary folder is then removed
    StageLine line;
    const PrepareReport report =
        prepare_scene(options, [&](int stage, int stages, const std::string& name, const std::string& count) {
            if (!quiet) line.show(stage, stages, name, count);
        });
    line.finish();
    for (const std::string& sentence : describe(report))
        log_message(is_poor(report) ? LogLevel::kWarn : LogLevel::kInfo, "{}", fmt::make_format_args(sentence));
    if (is_poor(report))
        log_warning(
            "photographs that were left out need more overlap with their neighbours, more texture, or to be sharper; "
            "colmap's log: {}",
            report.log.string());
    log_info("the scene is in {} (colmap's output: {}); train it with: gsapp train -s {} --eval",
             options.scene.string(), report.log.string(), options.scene.string());
    if (json) print_json(json_of(report, options.scene));
}

}  // namespace

void add_prepare_command(CLI::App& app, Command& selected) {
    auto options = std::make_shared<PrepareOptions>();
    CLI::App* command = app.add_subcommand(
        "prepare", "Find the cameras of photographs or a video with colmap and write a scene of undistorted images");
    command->add_option("source", options->source, "Folder of photographs, or a video")
        ->required()
        ->check(CLI::ExistingPath)
        ->type_name("PHOTOS");
    command->add_option("-o,--output", options->scene, "Scene folder to make")->required()->type_name("SCENE");
    command->add_option("--fps", options->fps,
                        "Frames a second to take from a video, the sharpest of each interval (default: 2)");
    command
        ->add_option("--camera-model", options->camera_model,
                     "Lens model of the photographs. EQUIRECTANGULAR: 360-degree photographs, kept as they are")
        ->capture_default_str()
        ->check(CLI::IsMember({"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
                               "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
                               "EQUIRECTANGULAR"}));
    command
        ->add_option("--matching", options->matching,
                     "Pairs to compare. exhaustive: all; sequential: neighbours in the order of names; vocab-tree: "
                     "those that look alike; auto: by number and names")
        ->capture_default_str()
        ->check(CLI::IsMember({"auto", "exhaustive", "sequential", "vocab-tree"}));
    command->add_option("--vocab-tree", options->vocab_tree, "Vocabulary tree of colmap (default: an installed one)")
        ->type_name("FILE");
    command->add_flag_function(
        "--gpu,!--cpu", [options](std::int64_t count) { options->gpu = count > 0; },
        "Where colmap computes features and matches (default: the GPU if colmap has CUDA)");
    command->add_flag("--overwrite", options->overwrite, "Replace an earlier scene at SCENE");
    const auto json = std::make_shared<bool>(false);
    add_outcome_flag(*command, *json);
    const CLI::Option* quiet = add_quiet_flag(*command);
    command->callback([=, &selected] { selected = [=] { run_prepare(*options, *json, quiet->count() > 0); }; });
}

}  // namespace gs
