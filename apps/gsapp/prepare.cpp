// SPDX-License-Identifier: Apache-2.0
// gsapp prepare: photographs to a scene, with colmap.
#include "lib/scene/prepare.h"

#include <unistd.h>

#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"

namespace gs {
namespace {

void run_prepare(const PrepareOptions& options) {
    catch_interrupts();  // colmap gets the signal as well; its temporary folder is then removed
    const bool terminal = ::isatty(STDERR_FILENO) == 1;
    int shown_stage = 0;
    prepare_scene(options, [&](int stage, int stages, const std::string& name, const std::string& count) {
        if (terminal) {
            std::fprintf(stderr, "%s[%d/%d] %-12s %-12s", stage == shown_stage ? "\r" : (shown_stage ? "\n" : ""),
                         stage, stages, name.c_str(), count.c_str());
            std::fflush(stderr);
        } else if (stage != shown_stage) {
            log_info("[{}/{}] {}", stage, stages, name);
        }
        shown_stage = stage;
    });
    if (terminal) std::fputs("\n", stderr);
    log_info("the scene is in {}; train it with: gsapp train -s {} --eval", options.scene.string(),
             options.scene.string());
}

}  // namespace

void add_prepare_command(CLI::App& app, Command& selected) {
    auto options = std::make_shared<PrepareOptions>();
    CLI::App* command =
        app.add_subcommand("prepare", "Find the cameras of photographs with colmap and write an undistorted scene");
    command->add_option("images", options->images, "Folder of photographs")
        ->required()
        ->check(CLI::ExistingDirectory)
        ->type_name("IMAGES");
    command->add_option("-o,--output", options->scene, "Scene folder to make")->required()->type_name("SCENE");
    command->add_option("--camera-model", options->camera_model, "Lens model of the photographs")
        ->capture_default_str()
        ->check(CLI::IsMember({"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
                               "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"}));
    command->add_option("--matcher", options->matcher, "exhaustive (any photographs) or sequential (a video's frames)")
        ->capture_default_str()
        ->check(CLI::IsMember({"exhaustive", "sequential"}));
    command->add_flag("--gpu,!--cpu", options->gpu, "Let colmap use the GPU (needs a colmap built with CUDA)");
    command->add_flag("--overwrite", options->overwrite, "Replace an earlier scene at SCENE");
    command->callback([options, &selected] { selected = [options] { run_prepare(*options); }; });
}

}  // namespace gs
