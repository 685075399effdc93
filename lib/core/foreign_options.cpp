// SPDX-License-Identifier: Apache-2.0
// The table of other programs' options, and its documentation page.
#include "lib/core/foreign_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>

#include "lib/core/options.h"

namespace gs {
namespace {

ForeignOption same(std::string name, std::string note = {}) {
    std::string key = name.substr(2);
    std::replace(key.begin(), key.end(), '_', '-');
    return {.name = std::move(name), .key = std::move(key), .note = std::move(note)};
}
ForeignOption synonym(std::string name, std::string key, std::string note = {}) {
    return {.name = std::move(name), .key = std::move(key), .note = std::move(note)};
}
ForeignOption sets(std::string name, std::string key, std::string value, std::string note = {}) {
    return {std::move(name), ForeignUse::kSets, std::move(key), std::move(value), std::move(note)};
}
/// Makes an option with a value that is ignored or missing, by `use`. `harmless` is the value without effect in the
/// other program.
ForeignOption without(ForeignUse use, std::string name, std::string note, std::string harmless = {}) {
    return {.name = std::move(name), .use = use, .value = std::move(harmless), .note = std::move(note)};
}
ForeignOption switch_without(ForeignUse use, std::string name, std::string note) {
    return {.name = std::move(name), .use = use, .note = std::move(note), .is_switch = true};
}
ForeignOption ignored(std::string name, std::string note, std::string harmless = {}) {
    return without(ForeignUse::kIgnored, std::move(name), std::move(note), std::move(harmless));
}
ForeignOption ignored_switch(std::string name, std::string note) {
    return switch_without(ForeignUse::kIgnored, std::move(name), std::move(note));
}
ForeignOption missing(std::string name, std::string note, std::string harmless = {}) {
    return without(ForeignUse::kMissing, std::move(name), std::move(note), std::move(harmless));
}
ForeignOption missing_switch(std::string name, std::string note) {
    return switch_without(ForeignUse::kMissing, std::move(name), std::move(note));
}
ForeignOption with_short(ForeignOption option, std::string short_name) {
    option.short_name = std::move(short_name);
    return option;
}

// Notes on features of several programs.
constexpr const char* kMipSplatting = "with the filters of Mip-Splatting";
constexpr const char* kNoServer = "there is no server for a viewer; --view shows the training in a browser";
constexpr const char* kNoViewer = "no viewer is opened unless --view asks for it";
constexpr const char* kOneWay = "there is one way to compute it";

ForeignProgram inria() {
    const char* exposure = "acts with --train_test_exp only; --ppisp on learns exposures, at --ppisp-lr";
    const char* depth = "acts with --depths only";
    return {"3DGS",
            "train.py",
            {same("--sh_degree"),
             with_short(synonym("--source_path", "source"), "-s"),
             with_short(synonym("--model_path", "model"), "-m"),
             with_short(same("--images"), "-i"),
             with_short(missing("--depths", "depth maps are not used as supervision"), "-d"),
             with_short(same("--resolution"), "-r"),
             with_short(sets("--white_background", "background", "white"), "-w"),
             missing_switch("--train_test_exp",
                            "exposures of test views are not fitted to half of each photograph; --ppisp on learns "
                            "exposures, and gsapp eval --ppisp-eval colour-aligned fits test views"),
             ignored("--data_device", "images stay on the device as far as they fit into --image-cache"),
             same("--eval"),
             ignored_switch("--convert_SHs_python", kOneWay),
             ignored_switch("--compute_cov3D_python", kOneWay),
             ignored_switch("--debug", "errors always name their place, and -v shows more messages"),
             same("--antialiasing", kMipSplatting),
             same("--iterations", "schedules follow it; `--schedule fixed` keeps those of 30000"),
             same("--position_lr_init"),
             same("--position_lr_final"),
             ignored("--position_lr_delay_mult", "3DGS delays the rate by 0 steps, so it has no effect there either"),
             same("--position_lr_max_steps"),
             same("--feature_lr"),
             same("--opacity_lr"),
             same("--scaling_lr"),
             same("--rotation_lr"),
             ignored("--exposure_lr_init", exposure),
             ignored("--exposure_lr_final", exposure),
             ignored("--exposure_lr_delay_steps", exposure),
             ignored("--exposure_lr_delay_mult", exposure),
             same("--percent_dense"),
             same("--lambda_dssim"),
             same("--densification_interval"),
             same("--opacity_reset_interval"),
             same("--densify_from_iter", "the first change itself: 3DGS's 500 is 600 here"),
             same("--densify_until_iter", "the last change itself: 3DGS's 15000 is 14900 here"),
             same("--densify_grad_threshold"),
             ignored("--depth_l1_weight_init", depth),
             ignored("--depth_l1_weight_final", depth),
             sets("--random_background", "background", "random", "scores are made on black"),
             ignored("--optimizer_type",
                     "Gaussians out of view wait, as with sparse_adam, and then make up for what they missed; with "
                     "`--adam all` they do not wait",
                     "sparse_adam"),
             ignored("--ip", kNoServer),
             ignored("--port", kNoServer),
             ignored("--debug_from", "errors always name their place, and -v shows more messages"),
             ignored_switch("--detect_anomaly", "values that are not finite are always found, removed and reported"),
             same("--test_iterations"),
             same("--save_iterations"),
             same("--quiet"),
             ignored_switch("--disable_viewer", kNoViewer),
             same("--checkpoint_iterations"),
             synonym("--start_checkpoint", "resume")}};
}

ForeignProgram gsplat() {
    const char* speed = "it is a matter of speed and memory";
    return {
        "gsplat",
        "simple_trainer.py",
        {synonym("--data_dir", "source"),
         synonym("--data_factor", "resolution", "gsplat's default is 4"),
         synonym("--result_dir", "model"),
         same("--test_every", "with `--eval`, which gsplat implies"),
         synonym("--max_steps", "iterations"),
         synonym("--eval_steps", "test-iterations", "with `--eval`"),
         synonym("--save_steps", "checkpoint-iterations"),
         synonym("--ply_steps", "save-iterations"),
         ignored_switch("--save_ply", "the last point cloud is always written"),
         same("--sh_degree"),
         synonym("--init_num_pts", "init-points"),
         synonym("--ssim_lambda", "lambda-dssim"),
         same("--opacity_reg"),
         same("--scale_reg"),
         synonym("--scales_lr", "scaling-lr"),
         synonym("--opacities_lr", "opacity-lr"),
         synonym("--quats_lr", "rotation-lr"),
         sets("--random_bkgd", "background", "random", "scores are made on black"),
         synonym("--strategy.cap-max", "cap-max"),
         synonym("--strategy.noise-lr", "noise-lr"),
         synonym("--strategy.refine-start-iter", "densify-from-iter", "the first change itself"),
         synonym("--strategy.refine-stop-iter", "densify-until-iter", "the last change itself"),
         synonym("--strategy.refine-every", "densification-interval"),
         synonym("--strategy.reset-every", "opacity-reset-interval"),
         synonym("--strategy.grow-grad2d", "densify-grad-threshold"),
         synonym("--strategy.grow-scale3d", "percent-dense"),
         sets("--antialiased", "antialiasing", "on", kMipSplatting),
         sets("--pose_opt", "refine-cameras", "on", "and focal lengths; rates follow from the length of the run"),
         missing_switch("--depth_loss", "depth is not used as supervision"),
         missing_switch("--app_opt", "there are no appearance embeddings; --ppisp on learns exposure and colour"),
         synonym("--batch_size", "batch", "each view counts as an iteration"),
         ignored_switch("--packed", speed),
         ignored_switch("--sparse_grad", speed),
         sets("--visible_adam", "adam", "visible", "the default; missed steps are made up for"),
         ignored_switch("--disable_viewer", kNoViewer),
         ignored("--port", kNoServer),
         ignored_switch("--disable_video", "no video is made; `gsapp render` makes pictures"),
         ignored("--tb_every",
                 "--tensorboard DIR writes event files, and stats/train.jsonl is the log: each every 100 iterations"),
         ignored("--lpips_net", "`gsapp eval --metrics lpips-vgg,lpips-alex` names the net"),
         missing("--ckpt",
                 "checkpoints of PyTorch are not read; a run is scored by `gsapp eval RUN`, and its pictures "
                 "are made by `gsapp render RUN`"),
         missing("--compression", "a run is made small by `gsapp export RUN -o DIR`"),
         ignored("--render_traj_path", "no video is made in training; `gsapp render --orbit N --video FILE` makes one"),
         missing("--data_type", "scenes are read as --source says", "colmap"),
         missing("--camera_model", "the scene's file names it; --lens says what is done with it", "pinhole"),
         missing("--patch_size", "whole images are trained on"),
         missing("--global_scale", "scenes of any size are brought to a usual one", "1"),
         ignored_switch("--normalize_world_space", "scenes of any size are brought to a usual one"),
         ignored_switch("--load_exposure", "--ppisp-exif uses it"),
         missing("--steps_scaler", "--iterations names the length, which schedules follow", "1"),
         missing("--init_type", "points are random if the scene has none; --init-points is their number", "sfm"),
         ignored("--init_extent", "acts with --init_type random only"),
         missing("--init_opa", "first opacities are those of 3DGS-MCMC"),
         missing("--init_scale", "first scales follow from the distances of points", "1"),
         missing("--sh_degree_interval", "degrees rise with the schedule"),
         missing("--near_plane", "it is fixed"),
         missing("--far_plane", "it is fixed"),
         synonym("--means_lr", "position-lr-init", "the final rate is --position-lr-final, a hundredth there"),
         synonym("--sh0_lr", "feature-lr"),
         missing("--shN_lr", "it is a twentieth of --feature-lr"),
         ignored("--pose_opt_lr", "acts with --pose_opt only"),
         ignored("--pose_opt_reg", "acts with --pose_opt only"),
         missing("--pose_noise", "no noise is added to camera poses", "0"),
         ignored("--app_embed_dim", "acts with --app_opt only"),
         ignored("--app_opt_lr", "acts with --app_opt only"),
         ignored("--app_opt_reg", "acts with --app_opt only"),
         missing("--post_processing", "--ppisp on learns exposure and colour; there are no bilateral grids"),
         missing_switch("--use_bilateral_grid", "there are no bilateral grids; --ppisp on learns exposure and colour"),
         ignored("--depth_lambda", "acts with --depth_loss only"),
         ignored_switch("--tb_save_image", "--preview-every N saves images"),
         missing_switch("--with_ut", "Gaussians are projected to first order, through the lens with --lens native"),
         missing_switch("--with_eval3d", "Gaussians are projected to first order, through the lens with --lens native"),
         missing_switch("--strategy.absgrad", "the norm of summed gradients decides, against --densify-grad-threshold"),
         missing_switch("--strategy.revised-opacity", "copies keep the opacity; --strategy mcmc corrects it"),
         missing("--strategy.prune-opa", "--strategy adc removes what is fainter than 0.005", "0.005"),
         missing("--strategy.min-opacity", "--strategy mcmc moves what is fainter than 0.005", "0.005"),
         ignored_switch("--strategy.verbose", "-v shows more messages")}};
}

ForeignProgram nerfstudio() {
    constexpr const char *kScored = "test views are scored at the end, and after --test-iterations",
                         *kFolder = "the run folder is what -m says",
                         *kFrame = "models are written in the coordinates of the scene as it is";
    return {
        "nerfstudio",
        "ns-train splatfacto",
        {synonym("--data", "source"),
         synonym("--output-dir", "model", "the run folder itself, without names and times below it"),
         synonym("--max-num-iterations", "iterations"),
         synonym("--pipeline.model.sh-degree", "sh-degree"),
         synonym("--pipeline.model.ssim-lambda", "lambda-dssim"),
         synonym("--pipeline.model.background-color", "background"),
         synonym("--pipeline.model.max-gs-num", "cap-max"),
         synonym("--pipeline.model.noise-lr", "noise-lr"),
         synonym("--pipeline.model.mcmc-opacity-reg", "opacity-reg"),
         synonym("--pipeline.model.mcmc-scale-reg", "scale-reg"),
         synonym("--pipeline.model.num-random", "init-points"),
         synonym("--machine.seed", "seed"),
         synonym("--machine.device-type", "device"),
         missing("--pipeline.model.rasterize-mode", "--antialiasing on draws with the filters of Mip-Splatting",
                 "classic"),
         missing("--pipeline.model.camera-optimizer.mode", "--refine-cameras on or auto learns poses and focal lengths",
                 "off"),
         ignored("--experiment-name", kFolder),
         ignored("--vis", kNoViewer),
         ignored("--viewer.quit-on-train-completion", "the program ends with the training"),
         ignored("--viewer.websocket-port", kNoServer),
         ignored("--steps-per-save", "checkpoints are written by --checkpoint-minutes and --checkpoint-iterations"),
         ignored("--save-only-latest-checkpoint", "those of --checkpoint-minutes replace each other"),
         ignored("--steps-per-eval-batch", kScored),
         ignored("--steps-per-eval-image", kScored),
         ignored("--steps-per-eval-all-images", kScored),
         ignored("--timestamp", kFolder),
         ignored("--project-name", kFolder),
         ignored("--method-name", kFolder),
         ignored("--relative-model-dir", kFolder),
         ignored("--mixed-precision", kOneWay),
         ignored("--use-grad-scaler", kOneWay),
         ignored("--logging.local-writer.enable", "-q and -v choose the messages"),
         ignored("--pipeline.datamanager.images-on-gpu", "images are kept where they fit, up to --image-cache"),
         ignored("--pipeline.datamanager.cache-images", "images are kept where they fit, up to --image-cache"),
         ignored("--pipeline.datamanager.cache-images-type", "images are kept where they fit, up to --image-cache"),
         ignored("--pipeline.model.output-depth-during-training", "`gsapp render --depth` makes depth maps"),
         missing("--load-dir", "--resume goes on with a run of gsapp, and --init begins with a .ply"),
         missing("--load-checkpoint", "--resume goes on with a run of gsapp, and --init begins with a .ply"),
         missing("--load-config", "-c reads a file of gsapp's options"),
         missing("--machine.num-devices", "--ranks names the number of GPUs", "1"),
         missing("--pipeline.model.strategy", "--strategy names it; `default` there is adc here", "mcmc"),
         missing("--pipeline.model.cull-alpha-thresh", "--strategy adc removes what is fainter than 0.005", "0.005"),
         missing("--pipeline.model.continue-cull-post-densification", "nothing is removed after --densify-until-iter",
                 "False"),
         missing("--pipeline.model.use-scale-regularization",
                 "there is no limit on the ratio of scales; --scale-reg makes scales small", "False"),
         missing("--pipeline.model.use-bilateral-grid",
                 "there are no bilateral grids; --ppisp on learns exposure and colour", "False"),
         missing("--pipeline.model.random-init",
                 "points are random if the scene has none; --init-points is their number", "False"),
         missing("--pipeline.model.num-downscales", "--coarse-until names the share trained at coarser sizes", "0"),
         synonym("--pipeline.model.densify-grad-thresh", "densify-grad-threshold"),
         synonym("--pipeline.model.densify-size-thresh", "percent-dense"),
         synonym("--pipeline.model.warmup-length", "densify-from-iter", "the first change itself"),
         synonym("--pipeline.model.stop-split-at", "densify-until-iter", "the last change itself"),
         synonym("--pipeline.model.refine-every", "densification-interval"),
         missing("--pipeline.model.reset-alpha-every", "--opacity-reset-interval counts iterations"),
         missing("--pipeline.model.sh-degree-interval", "degrees rise with the schedule"),
         synonym("--downscale-factor", "resolution"),
         synonym("--images-path", "images"),
         synonym("--eval-interval", "test-every", "with `--eval`"),
         missing("--eval-mode", "--test-every and --test-list choose the test views", "interval"),
         missing("--train-split-fraction", "--test-every and --test-list choose the test views"),
         missing("--colmap-path", "the scene's folder is searched", "sparse/0"),
         ignored("--orientation-method", kFrame),
         ignored("--center-method", kFrame),
         ignored("--auto-scale-poses", kFrame),
         ignored("--scale-factor", kFrame),
         ignored("--scene-scale", kFrame)}};
}

ForeignProgram lichtfeld() {
    return {"LichtFeld Studio",
            "LichtFeld-Studio",
            {synonym("--data-path", "source"), synonym("--output-path", "model"), synonym("--max-cap", "cap-max")}};
}

/// The words with which ns-train names the kind of a scene, which gsapp detects from the scene's files.
const std::set<std::string> kDataParsers = {"colmap", "nerfstudio-data", "blender-data", "instant-ngp-data"};

std::string counterpart(const ForeignOption& option) {
    switch (option.use) {
        case ForeignUse::kSynonym:
            return fmt::format("`--{}`", option.key);
        case ForeignUse::kSets:
            return fmt::format("`--{} {}`", option.key, option.value);
        case ForeignUse::kIgnored:
            return "ignored";
        case ForeignUse::kMissing:
            return "not yet";
    }
    return {};
}

std::string note(const ForeignOption& option) {
    if (option.value.empty() || option.use == ForeignUse::kSets) return option.note;
    return fmt::format("{} (`{}` is accepted)", option.note, option.value);
}

}  // namespace

const std::vector<ForeignCommand>& foreign_commands() {
    constexpr const char *kGsplat = "simple_trainer.py of gsplat", *kNerfstudio = "ns-train of nerfstudio";
    static const std::vector<ForeignCommand> commands = {
        {"default", kGsplat, {{"strategy", "adc"}, {"eval", "true"}, {"resolution", "4"}}},
        {"mcmc", kGsplat, {{"strategy", "mcmc"}, {"eval", "true"}, {"resolution", "4"}}},
        {"splatfacto", kNerfstudio, {{"strategy", "adc"}, {"eval", "true"}}},
        {"splatfacto-mcmc", kNerfstudio, {{"strategy", "mcmc"}, {"eval", "true"}}},
        {"splatfacto-big",
         kNerfstudio,
         {},
         "it makes more Gaussians; splatfacto with --densify-grad-threshold 0.0005 does so, too"}};
    return commands;
}

std::vector<std::string> with_foreign_command(std::vector<std::string> words) {
    if (words.size() < 2 || words[0] != "train") return words;
    const auto& commands = foreign_commands();
    const auto command =
        std::find_if(commands.begin(), commands.end(), [&](const ForeignCommand& c) { return c.word == words[1]; });
    std::error_code error;  // an existing path of this name is a scene
    if (command == commands.end() || std::filesystem::exists(words[1], error)) return words;
    words.insert(words.begin() + 1, kForeignCommandFlag);
    // ns-train names the kind of a scene by a separate word after the options of the model.
    for (std::size_t i = words.size() - 1; i > 2; --i)
        if (kDataParsers.contains(words[i]) &&
            (!words[i - 1].starts_with("--") || words[i - 1].find('=') != std::string::npos))
            words.erase(words.begin() + std::ptrdiff_t(i));
    return words;
}

const std::vector<ForeignProgram>& foreign_programs() {
    static const std::vector<ForeignProgram> programs = {inria(), gsplat(), nerfstudio(), lichtfeld()};
    return programs;
}

std::vector<std::string> spellings(const ForeignOption& option) {
    std::vector<std::string> all = {option.name};
    for (const auto& [from, to] : {std::pair{'_', '-'}, std::pair{'-', '_'}}) {
        std::string other = option.name;
        std::replace(other.begin() + 2, other.end(), from, to);
        if (std::find(all.begin(), all.end(), other) == all.end()) all.push_back(other);
    }
    if (!option.short_name.empty()) all.push_back(option.short_name);
    return all;
}

std::string coming_from_markdown() {
    std::string text =
        "# Coming from 3DGS, gsplat or nerfstudio\n\n"
        "This page is generated by `gsapp options --coming-from`.\n\n"
        "`gsapp train` takes the options below as the other programs spell them, with underscores or hyphens. An "
        "option\n"
        "that is *ignored* gets a warning that says why. One that is *not yet* there would change the result; it ends\n"
        "the program with exit code 2. `gsapp train --help` and [options.md](options.md) have gsapp's own options.\n\n"
        "| there | here |\n|---|---|\n"
        "| `python convert.py -s SCENE`, `ns-process-data images --data PHOTOS --output-dir SCENE` | `gsapp prepare "
        "PHOTOS -o SCENE` |\n"
        "| `python train.py -s SCENE -m RUN --eval` | `gsapp train -s SCENE -m RUN --eval` |\n"
        "| `python simple_trainer.py mcmc --data_dir SCENE --result_dir RUN` | `gsapp train mcmc --data_dir SCENE "
        "--result_dir RUN`, which means `--strategy mcmc --eval -r 4` |\n"
        "| `python simple_trainer.py default ...` | `gsapp train default ...`, which means `--strategy adc --eval "
        "-r 4` |\n"
        "| `ns-train splatfacto --data SCENE --output-dir RUN` | `gsapp train splatfacto --data SCENE --output-dir "
        "RUN`, which means `--strategy adc --eval` |\n"
        "| `python render.py -m RUN` | `gsapp render -m RUN --views all` |\n"
        "| `python render.py -m RUN --skip_train` | `gsapp render -m RUN --skip_train`, or `--views test` |\n"
        "| `ns-render camera-path --camera-path-filename FILE` | `gsapp render RUN --path FILE --video FILE.mp4` |\n"
        "| `python metrics.py -m RUN` | `gsapp eval -m RUN --protocol inria`, or `gsapp metrics -m RUN` |\n"
        "| `SIBR_gaussianViewer_app -m RUN` | `gsapp view RUN`; the run folder is one that SIBR reads, too |\n"
        "| `ns-export gaussian-splat` | RUN/point_cloud has the PLY; `gsapp export RUN` writes other formats |\n\n"
        "Defaults are those of 3DGS-MCMC with at most a million Gaussians (`--cap-max`). `--strategy adc` has the\n"
        "original rule of 3DGS, and `--schedule fixed` its iterations whatever the length of the run. `-1` in a list "
        "of\n"
        "iterations (`--test_iterations -1`, `--eval_steps -1`) is none of them, as there.\n";
    for (const ForeignProgram& program : foreign_programs()) {
        text += fmt::format("\n## {}: `{}`\n\n| there | here | |\n|---|---|---|\n", program.name, program.command);
        for (const ForeignOption& option : program.options) {
            const std::string also = option.short_name.empty() ? "" : fmt::format(", `{}`", option.short_name);
            text += fmt::format("| `{}`{} | {} | {} |\n", option.name, also, counterpart(option), note(option));
        }
    }
    return text;
}

}  // namespace gs
