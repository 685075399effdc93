// SPDX-License-Identifier: Apache-2.0
// Every setting of a training run, in parts by what they are about. The table in train_options.cpp is the one
// definition of names, ranges and help; command line, YAML files, saved configuration and docs/options.md are made from
// it.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "appearance/model_option.h"
#include "lib/core/background.h"
#include "lib/core/choices.h"
#include "lib/core/quantities.h"

namespace gs {

/// AppearanceOptions::appearance while the scene is to decide.
inline constexpr const char* kAutoAppearance = "auto";

/// The images of a scene, and how they are read and split.
struct SceneOptions {
    std::string source;  ///< scene folder, file, or builtin:NAME
    std::string images = "images";
    std::optional<int> resolution;  ///< 1,2,4,8: divisor; larger: width in px; empty: at most 1600 px, with a note
    bool eval = false;              ///< hold out test views
    int test_every = 8;             ///< every n-th view of the name-sorted list is a test view; 0 = none
    std::string test_list;          ///< file with one image name per line; overrides test_every
    MaskMode mask_mode = MaskMode::kIgnore;
    bool invert_masks = false;
    AlphaMode alpha_mode = AlphaMode::kTransparent;  ///< for RGBA photographs
    bool ppisp_exif = false;                         ///< read View::exif_exposure
    Background background;                           ///< black by default
};

/// What a run writes and says, and when.
struct OutputOptions {
    std::string model;  ///< output folder; empty = output/<scene>-<appearance>-<n>
    bool overwrite = false;
    std::string resume;  ///< checkpoint file or "latest"
    std::vector<std::int64_t> test_iterations, save_iterations, checkpoint_iterations;
    std::optional<double> checkpoint_minutes = 10;      ///< of training, between two checkpoints; empty = none
    std::optional<std::int64_t> preview_every;          ///< iterations between two previews; empty = none
    bool quiet = false, verbose = false, json = false;  ///< json: of one call, in no table and no file
    std::string tensorboard;                            ///< folder for event files; empty = none
};

/// The length of a run and what its schedules follow.
struct ScheduleOptions {
    std::int64_t iterations = 30000;
    Preset preset = Preset::kNone;
    std::optional<Duration> time_limit;  ///< of the training, saving included
    std::optional<double> target_psnr;   ///< dB on training views held out for it
    Recipe recipe = Recipe::kAuto;
    ScheduleKind schedule = ScheduleKind::kProgress;
    std::uint64_t seed = 0;
    double coarse_until = 0;  ///< share of the training with images of half size

    /// Returns whether the run ends after `iterations` steps; if not, time or quality ends it.
    bool ends_by_iterations() const { return !time_limit && !target_psnr; }
};

/// The largest model.
struct LimitOptions {
    std::int64_t cap_max = 1000000;       ///< Gaussians
    std::optional<ByteCount> size_limit;  ///< of the exported file
    SizeOf size_of = SizeOf::kWeb;
    std::optional<Duration> frame_limit;  ///< of a frame at 1280x720 on this device
};

/// The machine that computes, and how precisely.
struct DeviceOptions {
    Device device = Device::kAuto;
    int threads = 0;               ///< of the CPU; 0 = all cores
    std::optional<int> ranks = 1;  ///< processes of this machine that train together; empty = one for each GPU
    std::optional<int> batch;      ///< views of a step; empty = one for each rank
    bool deterministic = false;    ///< GPU only: fixed order of all sums
    ByteCount image_cache{std::uint64_t(4) << 30};  ///< for decoded images
    VerifyImages verify_images = VerifyImages::kAuto;
    double alpha_cutoff = 1;  ///< steps of 1/255
    double transmittance_cutoff = 1e-4;
    AppearanceStorage appearance_storage = AppearanceStorage::kFp32;  ///< GPU only
    AppearanceMoments appearance_moments = AppearanceMoments::kBf16;  ///< GPU only
};

/// The appearance model.
struct AppearanceOptions {
    std::string appearance = "sh";                              ///< a model's name, or "auto" until it is chosen
    std::optional<double> appearance_share = 1;                 ///< empty = auto
    std::optional<double> appearance_bytes;                     ///< mean size of a Gaussian's; empty: the share decides
    double auto_tolerance = 0.1;                                ///< dB
    ModelOptionValues model_options = default_model_options();  ///< what models declare: sh-degree, lobe-lr, ...
    ColorActivation color_activation = ColorActivation::kRelu;

    /// Returns whether Gaussians may lose their residual: for a share between 0 and 1, auto, and a number of bytes.
    bool takes_residuals_away() const { return appearance_bytes || !(appearance_share == 0 || appearance_share == 1); }
};

/// The photometric correction (PPISP).
struct PhotometricOptions {
    PpispMode ppisp = PpispMode::kOff;
    std::string ppisp_from;                             ///< ppisp.json of another run; implies on
    std::optional<std::int64_t> controller_iterations;  ///< 0 = no controller; empty = by schedule
    double ppisp_lr = 0.002;                            ///< learning rate of its parameters, after their warm-up
};

/// The first Gaussians.
struct StartOptions {
    std::string init;  ///< .ply file or run folder whose Gaussians the training begins with; empty = points
    std::int64_t init_points = 100000;  ///< random initialisation only
};

/// The loss and the learning rates (docs/math/optimization.md#learning-rates).
struct OptimizerOptions {
    double lambda_dssim = 0.2;
    double opacity_reg = 0.01;  ///< MCMC only
    double scale_reg = 0.01;    ///< MCMC only
    Movers adam = Movers::kVisible;
    double position_lr_init = 1.6e-4, position_lr_final = 1.6e-6;
    std::optional<std::int64_t> position_lr_max_steps;  ///< empty = by schedule
    double scaling_lr = 0.005, rotation_lr = 0.001;
    double feature_lr = 0.0025;
    std::optional<double> opacity_lr = 0.05;  ///< empty = auto, from the camera spacing
    double base_travel = 0;    ///< least product of the rate of base colours and the number of iterations
    double short_rates = 0;    ///< exponent of 10000/iterations by which rates are higher in shorter runs
    double far_rate = 0;       ///< exponent by which means beyond the scene extent have higher rates
    double residual_rate = 1;  ///< factor on the rates of the residual
    double final_rate = 1;     ///< share of the rates that is left at the end, means excepted
};

/// The change of the set of Gaussians.
struct DensificationOptions {
    Strategy strategy = Strategy::kMcmc;
    bool speedy_splat = false;                                          ///< with adc: Speedy-Splat's pruning by score
    std::optional<std::int64_t> densify_from_iter, densify_until_iter;  ///< empty = by schedule
    std::optional<std::int64_t> densification_interval;                 ///< empty = by schedule
    double densify_grad_threshold = 0.0002;
    double percent_dense = 0.01;                         ///< ADC only
    std::optional<std::int64_t> opacity_reset_interval;  ///< empty = by schedule
    GrowthBy growth_by = GrowthBy::kOpacity;
    double noise_lr = 5e5;
};

/// All settings. Functions and classes take the parts that they need.
struct TrainOptions : SceneOptions,
                      OutputOptions,
                      ScheduleOptions,
                      LimitOptions,
                      DeviceOptions,
                      AppearanceOptions,
                      PhotometricOptions,
                      StartOptions,
                      OptimizerOptions,
                      DensificationOptions {
    /// The keys of the options that a file or a flag set. Recipes and presets leave them alone. Not an option itself.
    std::set<std::string> named = {};
};

}  // namespace gs
