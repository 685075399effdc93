// SPDX-License-Identifier: Apache-2.0
// Every setting of a training run. The table in train_options.cpp is the one definition of names, ranges and help;
// command line, YAML files, saved configuration and docs/options.md are made from it.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "appearance/model_option.h"
#include "lib/core/background.h"
#include "lib/core/choices.h"

namespace gs {

/// TrainOptions::appearance while the scene is to decide.
inline constexpr const char* kAutoAppearance = "auto";

/// The number of ranks that stands for one on each GPU of this machine, and the most that there may be.
inline constexpr int kAllGpus = 4096;

struct TrainOptions {
    // Input and output
    std::string source;  ///< scene folder, file, or builtin:NAME
    std::string model;   ///< output folder; empty = output/<scene>-<appearance>-<n>
    std::string images = "images";
    int resolution = -1;  ///< 1,2,4,8 divisor; larger: width in px; -1: cap at 1600 px
    bool eval = false;
    int test_every = 8;
    std::string test_list;
    MaskMode mask_mode = MaskMode::kIgnore;
    bool invert_masks = false;
    AlphaMode alpha_mode = AlphaMode::kTransparent;
    std::string image_cache = "4GiB";  ///< byte budget for decoded images
    VerifyImages verify_images = VerifyImages::kAuto;
    bool overwrite = false;
    std::string resume;  ///< checkpoint file or "latest"
    // Run
    std::int64_t iterations = 30000;
    Preset preset = Preset::kNone;
    std::string time_limit;  ///< duration of the training, saving included; empty = none
    std::string size_limit;  ///< bytes of the exported file; empty = none
    SizeOf size_of = SizeOf::kWeb;
    std::string frame_limit;  ///< duration of a frame at 1280x720 on this device; empty = none
    double target_psnr = 0;   ///< dB on training views held out for it; 0 = none
    Recipe recipe = Recipe::kAuto;
    ScheduleKind schedule = ScheduleKind::kProgress;
    std::uint64_t seed = 0;
    Device device = Device::kAuto;
    int threads = 0;             ///< 0 = all cores
    int ranks = 1;               ///< processes of this machine that train together, or kAllGpus
    int batch = 0;               ///< views of a step; 0 = one for each rank
    bool deterministic = false;  ///< GPU only: fixed order of all sums
    std::vector<std::int64_t> test_iterations, save_iterations, checkpoint_iterations;
    double checkpoint_minutes = 10;  ///< of training, between two checkpoints; 0 = off
    std::int64_t preview_every = 0;  ///< 0 = off
    Background background;           ///< black by default
    // Precision
    double alpha_cutoff = 1;  ///< steps of 1/255
    double transmittance_cutoff = 1e-4;
    AppearanceStorage appearance_storage = AppearanceStorage::kFp32;  ///< GPU only
    AppearanceMoments appearance_moments = AppearanceMoments::kBf16;  ///< GPU only
    // Appearance
    std::string appearance = "sh";                              ///< a model's name, or "auto" until it is chosen
    double appearance_share = 1;                                ///< NaN = auto
    double appearance_bytes = 0;                                ///< mean size of a Gaussian's; 0: the share decides
    double auto_tolerance = 0.1;                                ///< dB
    ModelOptionValues model_options = default_model_options();  ///< what models declare: sh-degree, lobe-lr, ...
    ColorActivation color_activation = ColorActivation::kRelu;
    // Photometric correction (PPISP)
    PpispMode ppisp = PpispMode::kOff;
    bool ppisp_exif = false;
    std::string ppisp_from;                   ///< ppisp.json of another run; implies on
    std::int64_t controller_iterations = -1;  ///< 0 = no controller; -1 = by schedule
    // Initialisation
    std::string init;  ///< .ply file or run folder whose Gaussians the training begins with; empty = points
    std::int64_t init_points = 100000;  ///< random initialisation only
    // Loss
    double coarse_until = 0;  ///< share of the training with images of half size
    double lambda_dssim = 0.2;
    double opacity_reg = 0.01;  ///< MCMC only
    double scale_reg = 0.01;    ///< MCMC only
    Movers adam = Movers::kVisible;
    // Learning rates (docs/math/optimization.md#learning-rates)
    double position_lr_init = 1.6e-4, position_lr_final = 1.6e-6;
    std::int64_t position_lr_max_steps = -1;  ///< -1 = by schedule
    double scaling_lr = 0.005, rotation_lr = 0.001;
    double feature_lr = 0.0025;
    double opacity_lr = 0;     ///< 0 = 0.05 with mcmc or speedy_splat, else 0.025; NaN = auto, from the camera spacing
    double base_travel = 0;    ///< least product of the rate of base colours and the number of iterations
    double short_rates = 0;    ///< exponent of 10000/iterations by which rates are higher in shorter runs
    double far_rate = 0;       ///< exponent by which means beyond the scene extent have higher rates
    double residual_rate = 1;  ///< factor on the rates of the residual
    double final_rate = 1;     ///< share of the rates that is left at the end, means excepted
    double ppisp_lr = 0.002;   ///< learning rate of PPISP's parameters, after their warm-up
    // Densification
    Strategy strategy = Strategy::kMcmc;
    bool speedy_splat = false;  ///< with adc: Speedy-Splat's pruning by score
    std::int64_t cap_max = 1000000;
    std::int64_t densify_from_iter = -1, densify_until_iter = -1;  ///< -1 = by schedule
    std::int64_t densification_interval = -1;                      ///< -1 = by schedule
    double densify_grad_threshold = 0.0002;
    double percent_dense = 0.01;               ///< ADC only
    std::int64_t opacity_reset_interval = -1;  ///< -1 = by schedule
    GrowthBy growth_by = GrowthBy::kOpacity;
    double noise_lr = 5e5;
    // Logging
    bool quiet = false, verbose = false, json = false;  ///< json: of one call, in no table and no file
    std::string tensorboard;                            ///< folder for event files; empty = none

    /// The keys of the options that a file or a flag set. Recipes and presets leave them alone. Not an option itself.
    std::set<std::string> named = {};
};

}  // namespace gs
