// SPDX-License-Identifier: Apache-2.0
// All settings of a training run, grouped by topic. The table in train_options.cpp is the only definition of names,
// ranges and help; command line, YAML files, saved configuration and docs/options.md derive from it.
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

/// The value of AppearanceOptions::appearance for a choice by the scene.
inline constexpr const char* kAutoAppearance = "auto";

/// The images of a scene, and how they are read and split.
struct SceneOptions {
    std::string source;  ///< scene folder, file, or builtin:NAME
    std::string images = "images";
    std::optional<int> resolution;  ///< 1,2,4,8: divisor; larger: width in px; empty: width <= 1600 px, with a note
    bool eval = false;              ///< whether to hold out test views
    int test_every = 8;             ///< every n-th view of the name-sorted list is a test view; 0 = none
    std::string test_list;          ///< file with one image name per line; overrides test_every
    MaskMode mask_mode = MaskMode::kIgnore;
    bool invert_masks = false;
    LensMode lens = LensMode::kAuto;                 ///< treatment of lenses that are no pinholes
    AlphaMode alpha_mode = AlphaMode::kTransparent;  ///< meaning of alpha in RGBA photographs
    bool ppisp_exif = false;                         ///< whether to read View::exif_exposure
    Background background;                           ///< background colour; black by default
};

/// The files and messages of a run, and their times.
struct OutputOptions {
    std::string model;  ///< output folder; empty = output/<scene>-<appearance>-<n>
    bool overwrite = false;
    std::string resume;  ///< checkpoint file to resume from, or "latest"
    std::vector<std::int64_t> test_iterations, save_iterations, checkpoint_iterations;
    std::optional<double> checkpoint_minutes = 10;      ///< minutes of training between two checkpoints; empty = none
    std::optional<std::int64_t> preview_every;          ///< iterations between two previews; empty = none
    bool quiet = false, verbose = false, json = false;  ///< json applies to one call and is in no table or file
    std::string tensorboard;                            ///< folder of event files; empty = none
};

/// The length of a run and the scale of its schedules.
struct ScheduleOptions {
    std::int64_t iterations = 30000;
    Preset preset = Preset::kNone;
    std::optional<Duration> time_limit;  ///< time limit of the training, including saving
    std::optional<double> target_psnr;   ///< target PSNR on training views held out for it, dB
    Recipe recipe = Recipe::kAuto;
    ScheduleKind schedule = ScheduleKind::kProgress;
    std::uint64_t seed = 0;
    double coarse_until = 0;  ///< share of the training that uses images of half size

    /// Returns whether the run ends after `iterations` steps; otherwise time or quality ends it.
    bool ends_by_iterations() const { return !time_limit && !target_psnr; }
};

/// The limits of the model.
struct LimitOptions {
    std::int64_t cap_max = 1000000;       ///< largest number of Gaussians
    std::optional<ByteCount> size_limit;  ///< largest size of the exported file
    SizeOf size_of = SizeOf::kWeb;
    std::optional<Duration> frame_limit;  ///< largest render time at 1280x720 on this device
};

/// The device of the computation, and its precision.
struct DeviceOptions {
    Device device = Device::kAuto;
    int threads = 0;               ///< number of CPU threads; 0 = all cores
    std::optional<int> ranks = 1;  ///< number of processes on this machine that train together; empty = one per GPU
    std::optional<int> batch;      ///< number of views per step; empty = one per rank
    bool deterministic = false;    ///< GPU only: whether all sums have a fixed order
    ByteCount image_cache{std::uint64_t(4) << 30};  ///< memory for decoded images
    VerifyImages verify_images = VerifyImages::kAuto;
    double alpha_cutoff = 1;  ///< smallest alpha that is blended, in units of 1/255
    double transmittance_cutoff = 1e-4;
    AppearanceStorage appearance_storage = AppearanceStorage::kFp32;  ///< GPU only
    AppearanceMoments appearance_moments = AppearanceMoments::kBf16;  ///< GPU only
};

/// The appearance model.
struct AppearanceOptions {
    std::string appearance = "sh";                              ///< name of a model, or "auto" until it is chosen
    std::optional<double> appearance_share = 1;                 ///< share of Gaussians with a residual; empty = auto
    std::optional<double> appearance_bytes;                     ///< mean appearance bytes per Gaussian; empty: by share
    double auto_tolerance = 0.1;                                ///< PSNR tolerance of automatic choices, dB
    ModelOptionValues model_options = default_model_options();  ///< options of models: sh-degree, lobe-lr, ...
    ColorActivation color_activation = ColorActivation::kRelu;

    /// Returns whether Gaussians may lose their residual, which holds for a share between 0 and 1, for auto, and for a
    /// number of bytes.
    bool takes_residuals_away() const { return appearance_bytes || !(appearance_share == 0 || appearance_share == 1); }
};

/// The photometric correction (PPISP).
struct PhotometricOptions {
    PpispMode ppisp = PpispMode::kOff;
    std::string ppisp_from;                             ///< ppisp.json of another run; implies on
    std::optional<std::int64_t> controller_iterations;  ///< 0 = no controller; empty = by schedule
    double ppisp_lr = 0.002;                            ///< learning rate of the PPISP parameters after the warm-up
};

/// The cameras.
struct CameraOptions {
    RefineCameras refine_cameras = RefineCameras::kOff;
};

/// The initial Gaussians, and how they are drawn.
struct StartOptions {
    Antialiasing antialiasing = Antialiasing::kAuto;
    std::string init;                   ///< .ply file or run folder with the initial Gaussians; empty = points
    std::int64_t init_points = 100000;  ///< number of points; random initialisation only
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
    double base_travel = 0;    ///< smallest product of the base colours' rate and the number of iterations
    double short_rates = 0;    ///< exponent of 10000/iterations in the factor that raises rates in shorter runs
    double far_rate = 0;       ///< exponent of the factor that raises the rates of means beyond the scene extent
    double residual_rate = 1;  ///< factor on the learning rates of the residual
    double final_rate = 1;     ///< share of the rates that remains at the end, except for means
};

/// The changes of the set of Gaussians.
struct DensificationOptions {
    Strategy strategy = Strategy::kMcmc;
    bool speedy_splat = false;                                          ///< ADC only: prunes by Speedy-Splat's scores
    std::optional<std::int64_t> densify_from_iter, densify_until_iter;  ///< empty = by schedule
    std::optional<std::int64_t> densification_interval;                 ///< empty = by schedule
    double densify_grad_threshold = 0.0002;
    double percent_dense = 0.01;                         ///< ADC only
    std::optional<std::int64_t> opacity_reset_interval;  ///< empty = by schedule
    GrowthBy growth_by = GrowthBy::kOpacity;
    double noise_lr = 5e5;
};

/// All settings of a training. Functions and classes take only the parts that they need.
struct TrainOptions : SceneOptions,
                      OutputOptions,
                      ScheduleOptions,
                      LimitOptions,
                      DeviceOptions,
                      AppearanceOptions,
                      PhotometricOptions,
                      CameraOptions,
                      StartOptions,
                      OptimizerOptions,
                      DensificationOptions {
    /// The keys of the options that a file or a flag set. Recipes and presets do not change these options. Not an
    /// option itself.
    std::set<std::string> named = {};
};

}  // namespace gs
