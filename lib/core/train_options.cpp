// SPDX-License-Identifier: Apache-2.0
// The only definition of every option: name, spellings, range and help.
#include "lib/core/train_options.h"

#include <iterator>

#include "appearance/model_info.h"
#include "lib/core/options.h"

namespace gs {
namespace {

using O = TrainOptions;

// The largest number of iterations. A 32-bit range keeps every product with an interval within 64 bits.
constexpr double kMaxIterations = 2147483647.0;

/// An option under construction.
struct Entry : Option {
    /// Sets additional spellings, which the help shows.
    template <class... Names> Entry also(Names... more) { return names = {more...}, *this; }
    /// Sets the text of an empty value.
    Entry unset(std::string text) { return unset_word = std::move(text), *this; }
    /// Sets a word for the largest number.
    Entry or_max_word(std::string text) { return max_word = std::move(text), *this; }
    /// Sets the value if the flag is given without a value.
    Entry alone(std::string value) { return implicit = std::move(value), *this; }
    /// Marks the option as shown by --help.
    Entry basic() { return is_basic = true, *this; }
    Entry in_words(std::string allowed) { return values = std::move(allowed), *this; }
    Entry in_units(std::string name) { return unit = std::move(name), *this; }
    Entry of(Scope what) { return scope = what, *this; }
    /// Marks the value as the name of a file or folder.
    Entry path() { return is_path = true, *this; }
    /// Sets the measured effect of the option.
    Entry gives(std::string text) { return measured = std::move(text), *this; }
    /// Sets the value that recipe frontier uses instead of the default.
    Entry with_frontier(std::string value) { return frontier = std::move(value), *this; }
};

/// The range of allowed numbers, inclusive.
struct Range {
    std::optional<double> min = {}, max = {};
    std::string unit = {};
};

template <class T> Entry number(std::string key, T field, Range range, std::string help) {
    return {{.key = std::move(key),
             .field = field,
             .help = std::move(help),
             .unit = std::move(range.unit),
             .min = range.min,
             .max = range.max}};
}

/// Makes an option whose allowed values are described in words.
template <class T> Entry text(std::string key, T field, std::string values, std::string help) {
    return {{.key = std::move(key), .field = field, .help = std::move(help), .values = std::move(values)}};
}

/// Makes an option whose value is one of a list of words that is known only at run time.
Entry one_of(std::string key, std::string O::*field, std::vector<std::string> list, std::string help) {
    return {{.key = std::move(key), .field = field, .help = std::move(help), .choices = std::move(list)}};
}

template <class Part, Choice T> Entry choice(std::string key, T Part::*field, std::string help) {
    return {{.key = std::move(key), .field = field, .help = std::move(help), .choices = words<T>()}};
}

Entry flag(std::string key, bool O::*field, std::string help) {
    return {{.key = std::move(key), .field = field, .help = std::move(help)}};
}

std::vector<Option> input_options() {
    return {
        text("source", &O::source, "folder, file or builtin:NAME",
             "scene: a COLMAP or NeRF-synthetic folder, a transforms.json, or builtin:NAME")
            .path()
            .of(Scope::kScene)
            .also("-s")
            .basic(),
        text("model", &O::model, "folder", "output folder; empty: output/SCENE-APPEARANCE-N with the first free N")
            .of(Scope::kRun)
            .also("-m", "-o", "--output")
            .basic(),
        text("images", &O::images, "folder name", "image folder inside a COLMAP scene").of(Scope::kScene).also("-i"),
        number("resolution", &O::resolution, {1, 65536, "divisor or px"},
               "1, 2, 4, 8: divisor of the image size; larger: width in pixels; -1: full size, at most 1600 wide")
            .of(Scope::kScene)
            .unset("-1")
            .in_words("-1, 1, 2, 4, 8, or 16..65536")
            .also("-r")
            .basic(),
        flag("eval", &O::eval, "hold out test views and measure on them").of(Scope::kScene).basic(),
        number("test-every", &O::test_every, {0, 1000000, "images"},
               "with eval: every n-th image of the name-sorted list is a test view; 0: none")
            .of(Scope::kScene),
        text("test-list", &O::test_list, "file",
             "with eval: file with one test image name per line, instead of test-every")
            .path()
            .of(Scope::kScene),
        choice("lens", &O::lens,
               "photographs of lenses that are no pinholes: undistort = resample them to pinhole images, native = use "
               "them as they are, auto = native only if there is no pinhole image, as beyond 168 degrees")
            .of(Scope::kScene),
        choice("mask-mode", &O::mask_mode,
               "what masks mean: ignore = weight of the loss, transparent = the background shows there")
            .of(Scope::kScene),
        flag("invert-masks", &O::invert_masks, "masks are white where pixels are to be ignored").of(Scope::kScene),
        choice("alpha-mode", &O::alpha_mode,
               "what the alpha channel of photographs means: transparent = the background shows, mask = weight of "
               "the loss")
            .of(Scope::kScene),
        text("image-cache", &O::image_cache, "number with KiB, MiB, GiB, KB, MB or GB",
             "memory for decoded images, on the host and again on the GPU; images beyond it are read or sent again "
             "when needed")
            .of(Scope::kMachine)
            .in_units("bytes"),
        choice("verify-images", &O::verify_images,
               "decode all images before the training: what cannot be decoded is found then and not after hours; auto: "
               "for up to 4000 images")
            .of(Scope::kMachine)
            .alone("on"),
        flag("overwrite", &O::overwrite, "replace a run that is already in the output folder").of(Scope::kCall).basic(),
        text("resume", &O::resume, "file or latest",
             "continue from the latest checkpoint of the output folder; with a file, from that one")
            .of(Scope::kCall)
            .alone("latest")
            .basic(),
    };
}

std::vector<Option> run_options() {
    return {
        number("iterations", &O::iterations, {1, kMaxIterations, "iterations"}, "length of the training")
            .gives("7,500: lego -0.6 dB, bonsai -1.5 ([settings](lab/settings.md#the-frontier))")
            .basic(),
        choice("preset", &O::preset,
               "fast, balanced or best: 5000, 15000 or 30000 iterations; about a sixth, a half and all of the time, by "
               "recipe frontier")
            .gives("lego 36.33, 37.26 dB with fast, balanced; bonsai 32.96, 34.34 "
                   "([optimizer](lab/optimizer.md#steps-of-what-a-view-shows))")
            .basic(),
        text("time-limit", &O::time_limit, "a duration, e.g. 20s, 5m",
             "train for this long instead of for a number of iterations; final pruning and saving included")
            .gives("bonsai 34.22 dB in 10 s, 34.68 in 20 s; 89 runs used 99.2 to 100.9 % ([results](results.md#time))")
            .unset("")
            .basic(),
        text("size-limit", &O::size_limit, "a number with KB, MB, GB, KiB, MiB or GiB",
             "train a model whose exported file is at most this large; if possible, at least 95 % of it")
            .gives("bonsai 29.89 dB in 2 MB, 33.00 in 10 MB ([results](results.md#size))")
            .unset("")
            .basic(),
        choice("size-of", &O::size_of,
               "the file that size-limit is for: scene.ngsplat of the web export, the PLY, or the .splat file")
            .gives("the same limit for another file: a Gaussian of sh has 56 bytes for the web, 248 in a PLY "
                   "([results](results.md#appearance-models-on-five-scenes))"),
        text("frame-limit", &O::frame_limit, "a duration, e.g. 2ms",
             "train a model whose frames at 1280x720 take at most this long on this device")
            .gives("0.25 ms: lego 0.209 ms and 35.63 dB, bonsai 0.217 ms and 32.04 dB "
                   "([settings](lab/settings.md#options-one-at-a-time))")
            .unset(""),
        number("target-psnr", &O::target_psnr, {0, 60, "dB"},
               "train until every 8th training view, held out for it, has this PSNR on average, then make the model as "
               "small as that allows; --iterations is the most until it is reached; 0: off")
            .gives("ten targets, nine reached within 0.1 dB, with 4,730 to 94,468 Gaussians "
                   "([limits](lab/limits.md#targets))")
            .unset("0"),
        choice("recipe", &O::recipe,
               "paper: rates and images as the paper has them; frontier: defaults that give more quality in the same "
               "time (docs/training.md); auto: frontier with a limit or a preset, else paper")
            .gives("frontier, 10 s against 25 to 57 s of paper: lego +0.29 dB, bonsai -0.44, garden -0.26 "
                   "([limits](lab/limits.md#time))"),
        choice(
            "schedule", &O::schedule,
            "progress: rates, degrees and densification follow the share of the run that is done, so that a run of "
            "any length is complete; fixed: they stay at the iterations of a run of 30000, as other programs have it")
            .gives("fixed with 7,500 iterations: lego -2.2 dB, bonsai -2.9 against progress "
                   "([settings](lab/settings.md#the-frontier))"),
        number("seed", &O::seed, {}, "seed of every random number of the run").of(Scope::kRun).in_words("0..2^64-1"),
        choice("device", &O::device, "where the model is trained; auto: the GPU if there is one")
            .of(Scope::kScene)
            .basic(),
        number("threads", &O::threads, {0, 1024, "threads"}, "CPU threads; 0: all cores. Results do not depend on it")
            .of(Scope::kMachine),
        number("ranks", &O::ranks, {1, 4096, "processes"},
               "processes of this machine that train one model together, each with a part of the Gaussians "
               "and, on GPUs, one of its own; all: one for each GPU; torchrun and srun start them on "
               "several machines (docs/ranks.md)")
            .gives("two GPUs: 1.89 times as many views a second with 6 M Gaussians, 0.60 of the memory each "
                   "([results](results.md#several-gpus))")
            .unset("all")
            .also("--gpus"),
        number("batch", &O::batch, {0, 100, "views"},
               "views of which a step takes the mean gradient; each counts as an iteration; 0: one for each rank")
            .gives("4 on two GPUs: bonsai in 4.1 instead of 4.6 s, -0.09 dB ([results](results.md#several-gpus))")
            .unset("0"),
        flag("deterministic", &O::deterministic,
             "on the GPU: add in a fixed order, slower, so that runs with equal options give equal bytes on one GPU; "
             "the CPU always does")
            .gives("an iteration 2.13 times as long on lego, 8.90 times on bonsai "
                   "([results](results.md#frames-and-iterations))"),
        number("test-iterations", &O::test_iterations, {1, kMaxIterations, "iterations"},
               "with eval: iterations after which the test views are measured, besides the last; -1: none")
            .of(Scope::kRun),
        number("save-iterations", &O::save_iterations, {1, kMaxIterations, "iterations"},
               "iterations after which the PLY is saved, besides the last; -1: none")
            .of(Scope::kRun),
        number("checkpoint-iterations", &O::checkpoint_iterations, {1, kMaxIterations, "iterations"},
               "iterations after which a checkpoint is saved, besides the last; -1: none")
            .of(Scope::kRun),
        number("checkpoint-minutes", &O::checkpoint_minutes, {0, 1e6, "minutes"},
               "minutes of training after which a checkpoint is saved at the next multiple of 100 iterations; it "
               "replaces the one before that was saved for the same reason; 0: never")
            .of(Scope::kRun)
            .unset("0"),
        number("preview-every", &O::preview_every, {0, kMaxIterations, "iterations"},
               "save a preview image every n iterations; 0: never")
            .of(Scope::kRun)
            .unset("0"),
        text("background", &O::background, kBackgroundValues,
             "colour behind the scene, in training and evaluation; random: new in every iteration")
            .of(Scope::kScene)
            .basic(),
    };
}

std::vector<Option> precision_options() {
    return {
        number("alpha-cutoff", &O::alpha_cutoff, {1, 64, "steps of 1/255"},
               "fragments fainter than this are skipped; 1 is what 3DGS does, more is faster and less accurate")
            .gives("2, with transmittance-cutoff 1e-3: an iteration 7 to 10 % shorter, a pixel changes by 0.6 to 0.7 "
                   "of 255 ([settings](lab/settings.md#speed-against-accuracy))"),
        number("transmittance-cutoff", &O::transmittance_cutoff, {1e-4, 0.5},
               "a pixel that lets less light through is finished; 1e-4 is what 3DGS does, more is faster and less "
               "accurate")
            .gives("see alpha-cutoff"),
        choice("appearance-storage", &O::appearance_storage,
               "on the GPU: precision in which frames read what makes colours depend on the view; it is trained in "
               "single precision")
            .gives("fp16: frames of sh 1.4 % shorter, mean error 0.0006 instead of 0.0001 of 255 "
                   "([settings](lab/settings.md#speed-against-accuracy))"),
        choice(
            "appearance-moments", &O::appearance_moments,
            "on the GPU: precision of the optimizer's moments of the same parameters, which the CPU has in fp32; fp32 "
            "takes half as much memory again to train them, and more time")
            .gives("bf16: 180 bytes a Gaussian of sh and 4 % of an iteration less, the same quality "
                   "([precision](lab/precision.md#moments-in-32-bits))"),
    };
}

/// Returns the options that models declare: learning rates if `rates`, else all others.
std::vector<Option> options_of_models(bool rates) {
    std::vector<Option> table;
    for (const ModelOption& option : all_model_options()) {
        if (option.is_rate != rates) continue;
        const Range range{option.min, option.max, option.unit};
        table.push_back(number(option.key, ModelOptionField{option.key, option.is_whole}, range, option.help)
                            .unset(option.unset_word)
                            .gives(option.measured));
    }
    return table;
}

std::vector<Option> appearance_options() {
    std::vector<std::string> models = appearance_names();
    models.push_back(kAutoAppearance);
    return {
        one_of("appearance", &O::appearance, models,
               "view-dependent colour of one Gaussian; auto: the smallest model that held-out training views show to "
               "be enough, found in a part of the time of the training")
            .gives("lego 34.77 (none) to 36.39 dB (sv), bonsai 32.68 to 35.14 "
                   "([results](results.md#appearance-models-on-five-scenes))")
            .basic(),
        number(
            "appearance-share", &O::appearance_share, {0, 1},
            "share of the Gaussians whose colour depends on the view at the end; they are chosen from half of the run "
            "on, by what that is worth to the training views; auto: 35 %, and fewer as long as that costs little "
            "(auto-tolerance). With recipe paper final-rate is then 0.1 unless it is named, and opacities' rate falls "
            "from 26000 of 30000 on")
            .gives("auto: 39 % of the bytes; lego +0.06, bonsai +0.30 dB with sh "
                   "([results](results.md#choosing-the-appearance))")
            .unset("auto")
            .or_max_word("all"),
        number(
            "appearance-bytes", &O::appearance_bytes, {0, 1e6, "bytes"},
            "the same as a mean size: 4 bytes a parameter, 3 of them for the base colour; 0: appearance-share decides")
            .gives("40 with sv: lego -0.29 dB, bonsai +0.33, garden +0.16 ([residuals](math/residuals.md#on-a-gpu))")
            .unset("0"),
        number("auto-tolerance", &O::auto_tolerance, {0, 100, "dB"},
               "with appearance auto: how far the PSNR of the chosen model on the held-out views may be below the "
               "best one's; with appearance-share auto: the last choice ends when the training views have lost a "
               "quarter of this")
            .gives("0.1 dB is what seeds differ by ([results](results.md#appearance-models-on-five-scenes))"),
    };
}

std::vector<Option> start_options() {
    return {
        choice("color-activation", &O::color_activation, "function from raw to visible colour")
            .gives("softplus: +0.04 dB on lego against relu, sigmoid, hardsigmoid -0.05 "
                   "([results](results.md#other-settings))"),
        choice("antialiasing", &O::antialiasing,
               "draw the same at every distance and image size (Mip-Splatting): opacities make up for the dilation of "
               "small Gaussians, none is smaller than the photographs resolve; auto: as the model of --init, else off")
            .gives("at 2, 1, 1/2 and 1/4 of the training size: garden +5.4, -0.3, +7.7, +10.3 dB, bonsai +3.4, -0.3, "
                   "+7.3, +10.8 ([tries](lab/antialiasing.md))")
            .alone("on"),
        text("init", &O::init, ".ply file or run folder",
             "begin with the Gaussians of this point cloud, of gsapp or another 3DGS program, instead of the scene's "
             "points; also with another appearance, whose residual then begins at 0")
            .gives("goes on from models of gsapp and of other programs "
                   "([training](training.md#begin-with-a-trained-model))")
            .path(),
        number("init-points", &O::init_points, {1, 1e8, "Gaussians"},
               "random initialisation only: number of points that are drawn")
            .gives("lego with a cap of 30,000 keeps all of the 100,000 points that it begins with "
                   "([settings](lab/settings.md#densification-and-activations))"),
    };
}

std::vector<Option> camera_options() {
    return {
        choice("refine-cameras", &O::refine_cameras,
               "learn poses, focal lengths, principal points and distortion of the training images beside the scene; "
               "if COLMAP's model says which points an image shows, its camera stays near where it fits these; auto: "
               "if two short trainings show a gain on held-out training images")
            .gives("with aligned test cameras: a telephone's own poses 31.7 to 34.4 dB; garden off by 2 pixels 22.1 to "
                   "26.8, with the right poses 27.1 either way ([tries](lab/cameras.md))"),
    };
}

std::vector<Option> photometric_options() {
    return {
        choice("ppisp", &O::ppisp,
               "learn exposure and colour of every image; also vignetting and response of every camera; "
               "auto: if short trainings show a gain on held-out training images")
            .gives("bonsai +0.39 dB, an iteration 4.3 to 5.5 % longer; exposures of +-1 EV: +12.6 dB "
                   "([results](results.md#exposure))")
            .basic(),
        flag("ppisp-exif", &O::ppisp_exif,
             "with ppisp: exposures start from the images' EXIF data, which the controller is told as well")
            .gives("builtin:exposure, own test views: 32.37 instead of 21.00 and 19.98 dB "
                   "([appearance](lab/appearance.md#photometric-correction-ppisp))"),
        text("ppisp-from", &O::ppisp_from, "file ppisp.json",
             "take the correction, controller included, from another run and keep it as it is; images are matched by "
             "name. Turns ppisp on")
            .gives("trains another model with a finished correction "
                   "([training](training.md#exposure-that-changes))")
            .path(),
        number("controller-iterations", &O::controller_iterations, {0, kMaxIterations, "iterations"},
               "with ppisp: iterations after the training in which a controller learns to predict exposure and "
               "colour of new views from their render; 0: none; -1: a sixth of iterations (fixed: 5000), or a seventh "
               "of time-limit")
            .gives("bonsai: the default takes 5 s and is part of the gain of ppisp ([results](results.md#exposure))")
            .unset("-1"),
    };
}

std::vector<Option> loss_options() {
    return {
        number("lambda-dssim", &O::lambda_dssim, {0, 1}, "weight of 1 - SSIM; the L1 difference has one minus it")
            .gives("0.1: chair +0.08 dB, bonsai -0.07, garden +0.07 ([settings](lab/settings.md#the-frontier))"),
        number("opacity-reg", &O::opacity_reg, {0, 10}, "with mcmc: weight of the mean opacity")
            .gives("0.01 instead of 0.005: garden +0.09 dB, bonsai -0.07, lego -0.13 "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("0.005"),
        number("scale-reg", &O::scale_reg, {0, 10}, "with mcmc: weight of the mean scale")
            .gives("0.01 instead of 0.003: chair +0.09 dB, bonsai -0.06, garden -0.03 "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("0.003"),
    };
}

std::vector<Option> rate_options() {
    return {
        number("position-lr-init", &O::position_lr_init, {0, 10},
               "rate of the means at the start, times the scene extent")
            .gives("both twice: lego +0.03 dB, bonsai -0.08, four times: -0.16, -0.15 "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("2.24e-4"),
        number("position-lr-final", &O::position_lr_final, {0, 10},
               "rate of the means at the end, times the scene extent; log-linear in between")
            .gives("see position-lr-init")
            .with_frontier("2.24e-6"),
        number("position-lr-max-steps", &O::position_lr_max_steps, {1, kMaxIterations, "iterations"},
               "iteration at which the final rate of the means is reached; -1: 30000 of 30000")
            .gives("half of the run: lego -0.84 dB, bonsai -0.30 ([settings](lab/settings.md#options-one-at-a-time))")
            .unset("-1"),
        number("scaling-lr", &O::scaling_lr, {0, 10}, "rate of the log scales")
            .gives("half, twice: bonsai in 14 s +0.04, -0.18 dB ([settings](lab/settings.md#the-frontier))"),
        number("rotation-lr", &O::rotation_lr, {0, 10}, "rate of the rotations")
            .gives("half, twice: lego -0.06, +0.04 dB, bonsai -0.05, -0.05 "
                   "([settings](lab/settings.md#options-one-at-a-time))"),
        number("feature-lr", &O::feature_lr, {0, 10},
               "rate of the base colours, as coefficients of SH; what makes colours depend on the view has a rate in "
               "proportion, with sh a twentieth of it")
            .gives(
                "base colours half, twice: bonsai in 14 s +0.04, -0.20 dB ([settings](lab/settings.md#the-frontier))"),
        number("opacity-lr", &O::opacity_lr, {0, 10},
               "rate of the opacity logits; unless named, 0.025 with adc without speedy-splat; auto: 0.025 to 0.05, "
               "the higher the farther apart the cameras are")
            .gives("0.025, auto instead of 0.05: lego +0.07, +0.03 dB, bonsai +0.25, +0.21 in 15,000 iterations "
                   "([settings](lab/settings.md#densification-and-activations))")
            .unset("auto"),
        choice(
            "adam", &O::adam,
            "which Gaussians take a step: all, or those that its view shows, which make up for what they missed; the "
            "latter is faster if views show only a part of the scene")
            .gives("visible: bonsai 27.3 instead of 46.4 s, fern +0.5 dB, others within 0.2 "
                   "([optimizer](lab/optimizer.md#steps-of-what-a-view-shows))"),
        number("ppisp-lr", &O::ppisp_lr, {0, 1},
               "rate of exposures, colours, vignetting and responses after 500 of 30000 iterations, falling by 100 to "
               "the end; "
               "images that differ by stops are told apart better with 0.006")
            .gives("0.006: +0.5 to +1 dB where a glossy table fills the picture, -0.06 to -0.13 on bonsai "
                   "([appearance](lab/appearance.md#photometric-correction-ppisp))"),
    };
}

std::vector<Option> densification_options() {
    return {
        choice("strategy", &O::strategy,
               "how the number of Gaussians changes: mcmc = relocate and grow to the cap, adc = the original 3DGS "
               "rule")
            .gives("bonsai, sh: mcmc 34.01 dB with 1,456,190 Gaussians, adc 33.29 with 847,831 "
                   "([results](results.md#other-settings))"),
        flag("speedy-splat", &O::speedy_splat,
             "with adc: after each tenth of the training, from the second on, remove the Gaussians on which the "
             "training images depend least; 80 % of them while densification lasts, then 30 %")
            .gives("bonsai, sh: 32.13 dB with 98,541 Gaussians instead of 33.29 with 847,831 "
                   "([results](results.md#other-settings))")
            .also("--speedy"),
        number(
            "cap-max", &O::cap_max, {1, 1e9, "Gaussians"},
            "largest number of Gaussians; growth stops there, an initial model above it is kept; unless named, 100000 "
            "for built-in scenes")
            .gives("a tenth on bonsai: 32.40 instead of 34.01 dB, 9.8 instead of 20.2 s "
                   "([results](results.md#other-settings))")
            .basic(),
        number("densify-from-iter", &O::densify_from_iter, {0, kMaxIterations, "iterations"},
               "first iteration that changes the number of Gaussians; -1: 600 of 30000")
            .gives("half, twice: lego -0.01, +0.03 dB, bonsai +0.05, +0.06 "
                   "([settings](lab/settings.md#options-one-at-a-time))")
            .unset("-1"),
        number("densify-until-iter", &O::densify_until_iter, {0, kMaxIterations, "iterations"},
               "last iteration that changes the number of Gaussians; -1: 24900 of 30000 with mcmc, 14900 otherwise")
            .gives("18,000: chair -0.08, bonsai -0.09, garden -0.04 dB ([settings](lab/settings.md#the-frontier))")
            .unset("-1"),
        number("densification-interval", &O::densification_interval, {1, kMaxIterations, "iterations"},
               "iterations between two changes; -1: 100 of 30000, at least 10")
            .gives("twice as long: lego -0.04 dB; half: garden -0.02 ([settings](lab/settings.md#the-frontier))")
            .unset("-1"),
        number("densify-grad-threshold", &O::densify_grad_threshold, {0, 1},
               "with adc: mean image-space gradient above which a Gaussian is cloned or split")
            .gives(
                "4e-4: bonsai in 14 s +0.10 dB against 2e-4, 1e-4: -0.23 ([settings](lab/settings.md#the-frontier))"),
        number("percent-dense", &O::percent_dense, {0, 1},
               "with adc: share of the scene extent above which a growing Gaussian is split instead of cloned")
            .gives("half, twice: lego +0.38, -0.90 dB, bonsai +0.34, +0.60 "
                   "([settings](lab/settings.md#options-one-at-a-time))"),
        number("opacity-reset-interval", &O::opacity_reset_interval, {1, kMaxIterations, "iterations"},
               "with adc: iterations between two opacity resets; -1: 3000 of 30000")
            .gives("half, twice: lego -0.41, +0.07 dB, bonsai 0.00, +0.75 "
                   "([settings](lab/settings.md#options-one-at-a-time))")
            .unset("-1"),
        number("noise-lr", &O::noise_lr, {0, 1e9}, "with mcmc: strength of the noise on the means, times their rate")
            .gives("0.3 times: lego -0.18, bonsai in 14 s +0.22 dB; 3 times: bonsai -0.34 "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("3.5e5"),
    };
}

/// Returns the options that recipe frontier combines. Separately they serve for experiments with the recipe.
std::vector<Option> recipe_options() {
    return {
        number("coarse-until", &O::coarse_until, {0, 1}, "share of the training in which images have half their size")
            .gives("0.2: lego +0.07 dB, bonsai in 14 s +0.22, garden -0.07 ([settings](lab/settings.md#the-frontier))")
            .with_frontier("0.2"),
        number(
            "base-travel", &O::base_travel, {0, 1000},
            "least product of the first rate of base colours and the iterations, so that in short runs they get where "
            "they belong")
            .gives("with short-rates, in 1,800 steps: nasgabor 0.7 instead of 1.9 dB behind sh "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("3.5"),
        number("short-rates", &O::short_rates, {0, 2},
               "in runs of fewer than 10000 iterations all rates are higher, by this power of 10000/iterations")
            .gives(
                "0.7, small copies, 1,800 steps: lego +2.8 dB, bonsai +1.7 ([settings](lab/settings.md#the-frontier))")
            .with_frontier("0.7"),
        number("far-rate", &O::far_rate, {0, 1},
               "means farther from the cameras' mean than the scene extent have a rate that is higher by this power of "
               "their distance over the extent")
            .gives("1: garden +0.16 dB, chair, bonsai +0.06, lego +0.01, fern -0.04 "
                   "([settings](lab/settings.md#the-frontier))")
            .with_frontier("1"),
        number("residual-rate", &O::residual_rate, {0, 1000},
               "factor on the rates of what makes colours depend on the view")
            .gives("2: lego +0.16, bonsai +0.24 dB in 14 s; 4: +0.33 there ([settings](lab/settings.md#the-frontier))")
            .with_frontier("3"),
        number("final-rate", &O::final_rate, {0, 1},
               "share of the rates of scales, rotations, opacities and colours that is left at the end; they fall from "
               "20000 of 30000 on")
            .gives("0.1 from two thirds on: bonsai +0.47 dB, lego +0.01 ([settings](lab/settings.md#the-frontier))")
            .with_frontier("0.1"),
        choice("growth-by", &O::growth_by,
               "with mcmc: which Gaussians are copied to grow; opacity = the more opaque the likelier, gradient = also "
               "the larger the gradients of their colour")
            .gives("gradient: bonsai +0.05, garden +0.05, chair +0.09 dB ([settings](lab/settings.md#the-frontier))")
            .with_frontier("gradient"),
    };
}

std::vector<Option> logging_options() {
    return {
        flag("quiet", &O::quiet, "no progress and no messages below warnings").of(Scope::kMachine).also("-q").basic(),
        flag("verbose", &O::verbose,
             "messages of level debug, too; the options in force, the plan, the files that are read but for images")
            .of(Scope::kMachine)
            .also("-v")
            .basic(),
        text("tensorboard", &O::tensorboard, "folder",
             "folder for an event file of TensorBoard with loss, scores, number of Gaussians, learning rates and "
             "pictures; of several runs each has a folder in it; empty: none")
            .path()
            .of(Scope::kRun),
    };
}

void append(std::vector<Option>& table, const std::string& group, std::vector<Option> options) {
    for (Option& option : options) option.group = group;
    std::move(options.begin(), options.end(), std::back_inserter(table));
}

}  // namespace

const std::vector<Option>& train_option_table() {
    static const std::vector<Option> table = [] {
        std::vector<Option> t;
        append(t, "Input and output", input_options());
        append(t, "Run", run_options());
        append(t, "Precision", precision_options());
        append(t, "Model", appearance_options());
        append(t, "Model", options_of_models(false));
        append(t, "Model", start_options());
        append(t, "Photometric correction", photometric_options());
        append(t, "Cameras", camera_options());
        append(t, "Loss", loss_options());
        append(t, "Learning rates", rate_options());
        append(t, "Learning rates", options_of_models(true));
        append(t, "Densification", densification_options());
        append(t, "Logging", logging_options());
        append(t, "Experiments with the recipe", recipe_options());
        return t;
    }();
    return table;
}

}  // namespace gs
