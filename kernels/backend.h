// SPDX-License-Identifier: Apache-2.0
// What lib/ drives: one training model on one device. Nothing above this header knows which backend runs.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "kernels/camera.h"
#include "kernels/ceilings.h"
#include "kernels/core/gaussian_state.h"
#include "kernels/raster_config.h"

namespace gs {

/// A training target. Pointers stay valid until the call returns.
struct TargetImage {
    int width = 0, height = 0;
    int channels = 3;                    ///< 3 (rgb) or 4 (rgb + straight alpha, composited on the background)
    const std::uint8_t* u8 = nullptr;    ///< (H,W,channels), value/255; exactly one of u8 and f32 is set
    const float* f32 = nullptr;          ///< (H,W,channels), alpha in [0,1]
    const std::uint8_t* mask = nullptr;  ///< (H,W) loss weight/255, or null for weight 1
    std::int64_t id = -1;                ///< equal ids mean equal pixels, so that a device may keep its copy; -1 = unknown
};

/// Which colour is composited (appearance spec section 1.4).
enum class RenderMode { kFull, kBaseOnly, kResidualOnly };

/// Where the photometric correction of a view comes from.
enum class IspMode {
    kNone,       ///< the image is left as the Gaussians make it
    kFrame,      ///< exposure and colour of a training image
    kController, ///< exposure and colour predicted from the image itself; neutral if the model has no controller
};

/// How PPISP treats a view. Ignored by a model without PPISP.
struct IspView {
    IspMode mode = IspMode::kNone;
    int frame = -1;           ///< of kFrame; -1 = neutral
    int camera = 0;           ///< whose vignetting and response apply
    float prior_exposure = 0; ///< of kController: exposure in stops that is known beforehand, e.g. from EXIF
};

struct RenderRequest {
    CameraParams<float> camera;
    Vec3<float> background{0, 0, 0};
    RenderMode mode = RenderMode::kFull;
    IspView isp = {};
};

struct RenderedImage {
    int width = 0, height = 0;
    std::vector<float> rgb;   ///< planar (3,H,W), not clamped
    std::vector<float> alpha; ///< (H,W), 1 - final transmittance
};

/// One optimizer step on one view.
struct StepRequest {
    CameraParams<float> camera;
    Vec3<float> background{0, 0, 0};
    TargetImage target;
    std::int64_t iteration = 0;          ///< 0-based
    float lambda_dssim = 0.2f;
    float opacity_reg = 0.01f;           ///< weight of mean(opacity)
    float scale_reg = 0.01f;             ///< weight of mean(exp(raw_scale))
    float noise = 0;                     ///< SGLD factor 5e5*lr_means; 0 = no noise
    std::uint64_t seed = 0;
    bool gather_gradient_stats = false;  ///< ADC: accumulate the 2-D mean gradient norm, per view in which a tile is touched
    double rates[kNumGroups] = {};       ///< learning rate of this step per group
    std::vector<double> residual_rates;  ///< per residual column where the model has several; else empty
    double shared_rate = 0;              ///< learning rate of the shared weights
    IspView isp = {};                         ///< kFrame or kNone; of `distill`: kController
    double isp_rate = 0;                 ///< learning rate of PPISP's parameters; of `distill`: of the controller's weights; 0 = they stay
};

/// What happened since the last call of `take_stats`.
struct StepStats {
    std::int64_t steps = 0;
    double loss = 0, l1 = 0, ssim = 0;   ///< of the last step
    std::int64_t num_instances = 0;      ///< Gaussian-tile pairs of the last step
    std::int64_t num_nonfinite_gradients = 0; ///< Gaussians that sat a step out, summed
    std::int64_t consecutive_skips = 0;       ///< steps in a row skipped because the loss was not finite
};

/// What a backend holds in its device's memory.
struct MemoryUse {
    struct Row {
        std::string what;
        std::int64_t bytes = 0;
        std::string item;  ///< what the bytes grow with: "Gaussian", "instance", "pixel", "image"
        double items = 0;
    };
    std::vector<Row> rows;
    std::int64_t bytes = 0, peak = 0;
};

struct BackendOptions {
    bool deterministic = false;                      ///< fixed order of all sums: bitwise repeatable on one device, slower
    bool separate_appearance = false;                ///< CUDA: appearance in kernels of its own, through memory; for comparison
    std::int64_t image_budget = std::int64_t(4) << 30; ///< bytes of training images a device may keep
    double min_alpha = kMinAlpha;                    ///< fainter fragments are skipped; at least kMinAlpha
    double min_transmittance = kMinTransmittance;    ///< a pixel below this is finished
    bool half_residuals = false;                     ///< CUDA: frames read residual parameters rounded to half precision
    bool packed_moments = false;                     ///< CUDA: Adam's two moments of a residual parameter in 32 bits (bfloat16)
};

struct McmcParams {
    std::int64_t cap = 1000000;
    float min_opacity = 0.005f;
    double growth = 1.05;
};

struct AdcParams {
    float grad_threshold = 0.0002f;
    float extent = 1;                    ///< scene extent E, world units
    float dense_fraction = 0.01f;        ///< clone below, split above dense_fraction*E
    float min_opacity = 0.005f;
    bool prune_large = false;            ///< remove Gaussians larger than 0.1*E
    std::int64_t cap = 0;                ///< 0 = unlimited; growth stops at the cap
};

struct DensifyStats {
    std::int64_t relocated = 0, added = 0, cloned = 0, split = 0, pruned = 0, count = 0;
};

/// Time of one stage and what it worked on, summed since the last `take_stage_costs`.
struct StageCost {
    std::string stage;
    double seconds = 0;
    double items = 0;
    std::string item;     ///< what an item is, e.g. "pixel x Gaussian"
    double bytes = 0;     ///< least memory traffic of all items
    double operations = 0; ///< least arithmetic of all items, in single-precision instructions (an FMA is one)
    std::string note;     ///< why the stage takes longer than that, where it is known to; may be empty
    bool evaluates_appearance = false; ///< part of it is the appearance model's
};

class Backend {
  public:
    virtual ~Backend() = default;
    virtual std::string describe() const = 0;

    /// Replaces the whole model. Moments are zeroed where `state` has none.
    virtual void upload(const Gaussians& state) = 0;
    virtual Gaussians download(bool with_moments) = 0;
    virtual std::int64_t count() const = 0;
    virtual void set_active_degree(int degree) = 0;
    /// Replaces PPISP and leaves the Gaussians alone.
    virtual void upload_ppisp(const PpispState& state) = 0;
    /// PPISP without moments.
    virtual PpispState download_ppisp() = 0;

    virtual void render(const RenderRequest& request, RenderedImage& out) = 0;
    /// May return before the step is done. What `request` points to is not needed any more on return.
    virtual void step(const StepRequest& request) = 0;
    /// One optimizer step of the controller of the view's camera, everything else frozen: loss of the view as the controller
    /// corrects it, without opacity, scale and PPISP terms. Needs a model with controllers.
    virtual void distill(const StepRequest& request) = 0;
    /// Of the steps known to be done: up to three steps late on a device, unless `synchronize` was called.
    virtual StepStats take_stats() = 0;
    virtual void synchronize() = 0;

    /// Mean seconds of a frame over `repeats` rounds through all views, after one round to warm up. Images stay on the device.
    virtual double time_frames(const std::vector<RenderRequest>& views, int repeats) = 0;
    /// Stages are timed only while this is on (the marks between stages cost a few microseconds each).
    virtual void measure_stages(bool on) = 0;
    virtual std::vector<StageCost> take_stage_costs() = 0;
    /// Of the machine this backend runs on.
    virtual Ceilings measure_ceilings() = 0;
    virtual MemoryUse memory() = 0;

    virtual DensifyStats densify_mcmc(const McmcParams& params, std::int64_t iteration, std::uint64_t seed) = 0;
    virtual DensifyStats densify_adc(const AdcParams& params, std::int64_t iteration, std::uint64_t seed) = 0;
    /// ADC: raw opacity <- min(raw, logit 0.01), zero moments of the opacity group.
    virtual void reset_opacity() = 0;
    /// How much the images of `views` depend on each Gaussian (densification spec section 3): the sum over views and pixels of
    /// (dI/dG)^2, I the sum of the channels of the composited colour, G the Gaussian's value at the pixel. By row, finite or
    /// +infinity; 0 of what no view shows.
    virtual std::vector<float> scores(const std::vector<RenderRequest>& views) = 0;
    /// Removes the share `ratio` (0..1) of lowest scores, and all that score the same as the last of them; at least 1 % stay
    /// (score_rule.h). Returns how many went.
    virtual std::int64_t prune_lowest_scores(const std::vector<RenderRequest>& views, double ratio) = 0;
    /// Orders all rows by the Morton code of the mean (optimization spec section 6).
    virtual void morton_sort() = 0;
    /// Removes Gaussians whose parameters are not finite or beyond kLargestParameter (rows_device.h); counts per group go to `by_group`.
    virtual std::int64_t prune_nonfinite(std::int64_t by_group[kNumGroups]) = 0;
    /// Removes what can never be seen: opacity < 1/255 or |q|^2 < 1e-8. Returns how many.
    virtual std::int64_t prune_invisible() = 0;
};

/// Backend on the CPU for one appearance model. Throws UsageError for an unknown model.
std::unique_ptr<Backend> make_cpu_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

/// Backend on the current CUDA device. Throws UsageError for an unknown model, DeviceError without CUDA (cuda_device.h).
std::unique_ptr<Backend> make_cuda_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

}  // namespace gs
