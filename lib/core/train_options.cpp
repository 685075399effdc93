// SPDX-License-Identifier: Apache-2.0
// The one definition of every option: name, spellings, range and help.
#include "lib/core/train_options.h"

#include "appearance/model_info.h"
#include "lib/core/options.h"

namespace gs {
namespace {

using O = TrainOptions;
using Table = std::vector<Option>;

// Iteration counts: a 32-bit range keeps every product with an interval inside 64 bits.
constexpr double kMaxIterations = 2147483647.0;

void add_input_options(Table& table) {
    const std::string group = "Input and output";
    table.push_back({.key = "source",
                     .field = &O::source,
                     .group = group,
                     .help = "scene to train on: a COLMAP folder, a NeRF-synthetic folder, a transforms.json, or builtin:NAME",
                     .values = "folder, file or builtin:NAME",
                     .names = {"-s"},
                     .hidden_names = {"--source_path", "--source-path", "--data-path"}});
    table.push_back({.key = "model",
                     .field = &O::model,
                     .group = group,
                     .help = "output folder; empty: output/SCENE-APPEARANCE-N with the first free N",
                     .values = "folder",
                     .names = {"-m", "-o", "--output"},
                     .hidden_names = {"--model_path", "--model-path", "--output-path"}});
    table.push_back({.key = "images",
                     .field = &O::images,
                     .group = group,
                     .help = "image folder inside a COLMAP scene",
                     .values = "folder name",
                     .names = {"-i"}});
    table.push_back({.key = "resolution",
                     .field = &O::resolution,
                     .group = group,
                     .help = "1, 2, 4, 8: divisor of the image size; larger: width in pixels; -1: full size, at most 1600 wide",
                     .unit = "divisor or px",
                     .min = -1,
                     .max = 65536,
                     .values = "-1, 1, 2, 4, 8, or 16..65536",
                     .names = {"-r"}});
    table.push_back({.key = "eval", .field = &O::eval, .group = group, .help = "hold out test views and measure on them"});
    table.push_back({.key = "test-every",
                     .field = &O::test_every,
                     .group = group,
                     .help = "with eval: every n-th image of the name-sorted list is a test view; 0: none",
                     .unit = "images",
                     .min = 0,
                     .max = 1000000});
    table.push_back({.key = "test-list",
                     .field = &O::test_list,
                     .group = group,
                     .help = "with eval: file with one test image name per line, instead of test-every",
                     .values = "file"});
    table.push_back({.key = "mask-mode",
                     .field = &O::mask_mode,
                     .group = group,
                     .help = "what masks mean: ignore = weight of the loss, transparent = the background shows there",
                     .choices = {"ignore", "transparent"}});
    table.push_back(
        {.key = "invert-masks", .field = &O::invert_masks, .group = group, .help = "masks are white where pixels are to be ignored"});
    table.push_back({.key = "alpha-mode",
                     .field = &O::alpha_mode,
                     .group = group,
                     .help = "what the alpha channel of photographs means: transparent = the background shows, mask = weight of the loss",
                     .choices = {"transparent", "mask"}});
    table.push_back({.key = "image-cache",
                     .field = &O::image_cache,
                     .group = group,
                     .help = "memory for decoded images, on the host and again on the GPU; images beyond it are read or sent again when needed",
                     .unit = "bytes",
                     .values = "number with KiB, MiB, GiB, KB, MB or GB"});
    table.push_back(
        {.key = "overwrite", .field = &O::overwrite, .group = group, .help = "replace a run that is already in the output folder"});
    table.push_back({.key = "resume",
                     .field = &O::resume,
                     .group = group,
                     .help = "continue from a checkpoint file, or from the latest one in the output folder",
                     .values = "file or latest",
                     .hidden_names = {"--start_checkpoint", "--start-checkpoint"},
                     .implicit = "latest"});
}

void add_run_options(Table& table) {
    const std::string group = "Run";
    table.push_back({.key = "iterations",
                     .field = &O::iterations,
                     .group = group,
                     .help = "length of the training",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back(
        {.key = "seed", .field = &O::seed, .group = group, .help = "seed of every random number of the run", .values = "0..2^64-1"});
    table.push_back({.key = "device",
                     .field = &O::device,
                     .group = group,
                     .help = "where the model is trained; auto: the GPU where there is one",
                     .choices = {"auto", "cpu", "cuda"}});
    table.push_back({.key = "threads",
                     .field = &O::threads,
                     .group = group,
                     .help = "CPU threads; 0: all cores. Results do not depend on it",
                     .unit = "threads",
                     .min = 0,
                     .max = 1024});
    table.push_back({.key = "deterministic",
                     .field = &O::deterministic,
                     .group = group,
                     .help = "on the GPU: add in a fixed order, slower, so that runs with equal options give equal bytes on one GPU; the CPU always does"});
    table.push_back({.key = "separate-appearance",
                     .field = &O::separate_appearance,
                     .group = group,
                     .help = "on the GPU: evaluate appearance in kernels of its own instead of within projection and update; slower, to compare and to check"});
    table.push_back({.key = "test-iterations",
                     .field = &O::test_iterations,
                     .group = group,
                     .help = "with eval: iterations after which the test views are measured, besides the last",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "save-iterations",
                     .field = &O::save_iterations,
                     .group = group,
                     .help = "iterations after which the PLY is saved, besides the last",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "checkpoint-iterations",
                     .field = &O::checkpoint_iterations,
                     .group = group,
                     .help = "iterations after which a checkpoint is saved, besides the last",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "preview-every",
                     .field = &O::preview_every,
                     .group = group,
                     .help = "save a preview image every n iterations; 0: never",
                     .unit = "iterations",
                     .min = 0,
                     .max = kMaxIterations});
    table.push_back({.key = "background",
                     .field = &O::background,
                     .group = group,
                     .help = "colour behind the scene, in training and evaluation; random: new in every iteration",
                     .values = "black, white, random, or R,G,B with numbers in 0..1"});
}

void add_precision_options(Table& table) {
    const std::string group = "Precision";
    table.push_back({.key = "alpha-cutoff",
                     .field = &O::alpha_cutoff,
                     .group = group,
                     .help = "fragments fainter than this are skipped; 1 is what 3DGS does, more is faster and less accurate",
                     .unit = "steps of 1/255",
                     .min = 1,
                     .max = 64});
    table.push_back({.key = "transmittance-cutoff",
                     .field = &O::transmittance_cutoff,
                     .group = group,
                     .help = "a pixel that lets less light through is finished; 1e-4 is what 3DGS does, more is faster and less accurate",
                     .min = 1e-4,
                     .max = 0.5});
    table.push_back({.key = "appearance-storage",
                     .field = &O::appearance_storage,
                     .group = group,
                     .help = "on the GPU: precision in which frames read what makes colours depend on the view; it is trained in single precision",
                     .choices = {"fp32", "fp16"}});
    table.push_back({.key = "appearance-moments",
                     .field = &O::appearance_moments,
                     .group = group,
                     .help = "on the GPU: precision of the optimizer's moments of the same parameters; bf16 takes a third of their training memory away",
                     .choices = {"fp32", "bf16"}});
}

/// The options that models declare: their learning rates, or all others.
void add_options_of_models(Table& table, const std::string& group, bool rates) {
    for (const ModelOption& option : all_model_options()) {
        if (option.is_rate != rates) continue;
        table.push_back({.key = option.key,
                         .field = ModelOptionField{option.key, option.is_whole},
                         .group = group,
                         .help = option.help,
                         .unit = option.unit,
                         .min = option.min,
                         .max = option.max,
                         .nan_word = option.nan_word});
    }
}

void add_model_options(Table& table) {
    const std::string group = "Model";
    std::vector<std::string> models = appearance_names();
    models.push_back(kAutoAppearance);
    table.push_back({.key = "appearance",
                     .field = &O::appearance,
                     .group = group,
                     .help = "view-dependent colour of one Gaussian; auto: the smallest model that held-out training views show to be enough, "
                             "found in a part of the time of the training",
                     .choices = models});
    table.push_back({.key = "auto-tolerance",
                     .field = &O::auto_tolerance,
                     .group = group,
                     .help = "with appearance auto: how far the PSNR of the chosen model on the held-out views may be below the best one's",
                     .unit = "dB",
                     .min = 0,
                     .max = 100});
    add_options_of_models(table, group, false);
    table.push_back({.key = "color-activation",
                     .field = &O::color_activation,
                     .group = group,
                     .help = "function from raw to visible colour",
                     .choices = {"relu", "softplus", "sigmoid", "hardsigmoid"}});
    table.push_back({.key = "init-points",
                     .field = &O::init_points,
                     .group = group,
                     .help = "random initialisation only: number of points that are drawn",
                     .unit = "Gaussians",
                     .min = 1,
                     .max = 1e8});
    table.push_back({.key = "hostile-start",
                     .field = &O::hostile_start,
                     .group = group,
                     .help = "stress test: share of the first Gaussians whose opacity, scale, rotation and colour are set to extremes, from which "
                             "training has to recover",
                     .min = 0,
                     .max = 1});
}

void add_photometric_options(Table& table) {
    const std::string group = "Photometric correction";
    table.push_back({.key = "ppisp",
                     .field = &O::ppisp,
                     .group = group,
                     .help = "learn exposure and colour of every image, vignetting and response of every camera beside the scene; auto: only if the images "
                             "of the first 1000 iterations turn out to differ",
                     .choices = {"off", "on", "auto"}});
    table.push_back({.key = "ppisp-exif",
                     .field = &O::ppisp_exif,
                     .group = group,
                     .help = "with ppisp: exposures start from the images' EXIF data, which the controller is told as well"});
    table.push_back({.key = "ppisp-from",
                     .field = &O::ppisp_from,
                     .group = group,
                     .help = "take the correction, controller included, from another run and keep it as it is; images are matched by name. Turns ppisp on",
                     .values = "file ppisp.json"});
    table.push_back({.key = "controller-iterations",
                     .field = &O::controller_iterations,
                     .group = group,
                     .help = "with ppisp: iterations after the training in which a controller learns to predict exposure and colour of new views from "
                             "their render; 0: none",
                     .unit = "iterations",
                     .min = 0,
                     .max = kMaxIterations});
}

void add_loss_options(Table& table) {
    const std::string group = "Loss";
    table.push_back({.key = "lambda-dssim",
                     .field = &O::lambda_dssim,
                     .group = group,
                     .help = "weight of 1 - SSIM; the L1 difference has one minus it",
                     .min = 0,
                     .max = 1});
    table.push_back({.key = "opacity-reg",
                     .field = &O::opacity_reg,
                     .group = group,
                     .help = "with mcmc: weight of the mean opacity",
                     .min = 0,
                     .max = 10});
    table.push_back(
        {.key = "scale-reg", .field = &O::scale_reg, .group = group, .help = "with mcmc: weight of the mean scale", .min = 0, .max = 10});
}

void add_rate_options(Table& table) {
    const std::string group = "Learning rates";
    table.push_back({.key = "position-lr-init",
                     .field = &O::position_lr_init,
                     .group = group,
                     .help = "rate of the means at the start, times the scene extent",
                     .min = 0,
                     .max = 10});
    table.push_back({.key = "position-lr-final",
                     .field = &O::position_lr_final,
                     .group = group,
                     .help = "rate of the means at the end, times the scene extent; log-linear in between",
                     .min = 0,
                     .max = 10});
    table.push_back({.key = "position-lr-max-steps",
                     .field = &O::position_lr_max_steps,
                     .group = group,
                     .help = "iteration at which the final rate of the means is reached",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "scaling-lr", .field = &O::scaling_lr, .group = group, .help = "rate of the log scales", .min = 0, .max = 10});
    table.push_back({.key = "rotation-lr", .field = &O::rotation_lr, .group = group, .help = "rate of the rotations", .min = 0, .max = 10});
    table.push_back({.key = "opacity-lr",
                     .field = &O::opacity_lr,
                     .group = group,
                     .help = "rate of the opacity logits; 0: 0.05 with mcmc and with speedy-splat, 0.025 otherwise; auto: 0.025 to "
                             "0.05, the higher the farther apart the cameras are",
                     .min = 0,
                     .max = 10,
                     .nan_word = "auto"});
    table.push_back({.key = "ppisp-lr",
                     .field = &O::ppisp_lr,
                     .group = group,
                     .help = "rate of exposures, colours, vignetting and responses after 500 iterations, falling by 100 in 30000; images that differ by "
                             "stops are told apart better with 0.006",
                     .min = 0,
                     .max = 1});
    add_options_of_models(table, group, true);
}

void add_densification_options(Table& table) {
    const std::string group = "Densification";
    table.push_back({.key = "strategy",
                     .field = &O::strategy,
                     .group = group,
                     .help = "how the number of Gaussians changes: mcmc = relocate and grow to the cap, adc = the original 3DGS rule",
                     .choices = {"mcmc", "adc", "none"}});
    table.push_back({.key = "speedy-splat",
                     .field = &O::speedy_splat,
                     .group = group,
                     .help = "with adc: every 3000 iterations from 6000 on, remove the Gaussians that the training images depend on least; 80 % of them "
                             "while densification lasts, then 30 %",
                     .names = {"--speedy"}});
    table.push_back({.key = "cap-max",
                     .field = &O::cap_max,
                     .group = group,
                     .help = "largest number of Gaussians; growth stops there, an initial model above it is kept",
                     .unit = "Gaussians",
                     .min = 1,
                     .max = 1e9});
    table.push_back({.key = "densify-from-iter",
                     .field = &O::densify_from_iter,
                     .group = group,
                     .help = "first iteration that changes the number",
                     .unit = "iterations",
                     .min = 0,
                     .max = kMaxIterations});
    table.push_back({.key = "densify-until-iter",
                     .field = &O::densify_until_iter,
                     .group = group,
                     .help = "last iteration that changes the number; -1: 24900 with mcmc, 14900 otherwise",
                     .unit = "iterations",
                     .min = -1,
                     .max = kMaxIterations});
    table.push_back({.key = "densification-interval",
                     .field = &O::densification_interval,
                     .group = group,
                     .help = "iterations between two changes",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "densify-grad-threshold",
                     .field = &O::densify_grad_threshold,
                     .group = group,
                     .help = "with adc: mean image-space gradient above which a Gaussian is cloned or split",
                     .min = 0,
                     .max = 1});
    table.push_back({.key = "opacity-reset-interval",
                     .field = &O::opacity_reset_interval,
                     .group = group,
                     .help = "with adc: iterations between two opacity resets",
                     .unit = "iterations",
                     .min = 1,
                     .max = kMaxIterations});
    table.push_back({.key = "noise-lr",
                     .field = &O::noise_lr,
                     .group = group,
                     .help = "with mcmc: strength of the noise on the means, times their rate",
                     .min = 0,
                     .max = 1e9});
}

void add_logging_options(Table& table) {
    const std::string group = "Logging";
    table.push_back(
        {.key = "quiet", .field = &O::quiet, .group = group, .help = "no progress and no messages below warnings", .names = {"-q"}});
    table.push_back({.key = "verbose", .field = &O::verbose, .group = group, .help = "messages of level debug", .names = {"-v"}});
    table.push_back({.key = "log-level",
                     .field = &O::log_level,
                     .group = group,
                     .help = "least important messages that are shown",
                     .choices = {"trace", "debug", "info", "warn", "error"}});
}

}  // namespace

const std::vector<Option>& train_option_table() {
    static const Table table = [] {
        Table t;
        add_input_options(t);
        add_run_options(t);
        add_precision_options(t);
        add_model_options(t);
        add_photometric_options(t);
        add_loss_options(t);
        add_rate_options(t);
        add_densification_options(t);
        add_logging_options(t);
        return t;
    }();
    return table;
}

}  // namespace gs
