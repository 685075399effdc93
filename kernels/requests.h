// SPDX-License-Identifier: Apache-2.0
// The data that crosses the Backend interface: views and targets go in; images, statistics and costs come out.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "kernels/base/vec.h"
#include "kernels/splat/camera.h"
#include "kernels/splat/camera_gradient.h"
#include "kernels/splat/raster_config.h"
#include "kernels/splat/view_report.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Identifies the image of a training view at one of its sizes.
struct ImageId {
    std::int32_t view = -1;   ///< index among the training views; -1: unknown, for an image that is used once
    std::int32_t factor = 1;  ///< factor by which the image is reduced

    bool is_known() const { return view >= 0; }
    auto operator<=>(const ImageId&) const = default;
};

struct ImageIdHash {
    std::size_t operator()(const ImageId& id) const { return (std::size_t(id.factor) << 32) + std::size_t(id.view); }
};

/// The photograph with which a step compares its render. The pointers must stay valid until the call returns.
struct TargetImage {
    int width = 0, height = 0;
    int channels = 3;                    ///< 3 (rgb) or 4 (rgb + straight alpha, composited on the background)
    const std::uint8_t* u8 = nullptr;    ///< (H,W,channels), value/255; exactly one of u8 and f32 is set
    const float* f32 = nullptr;          ///< (H,W,channels), alpha in [0,1]
    const std::uint8_t* mask = nullptr;  ///< (H,W), value/255 is the weight of the loss; null: 1
    ImageId id;                          ///< equal known ids must mean equal pixels: a device may keep its copy
};

/// The colour to be composited (docs/math/appearance.md#render-modes).
enum class RenderMode { kFull, kBaseOnly, kResidualOnly };

/// The source of a view's photometric correction.
enum class IspMode {
    kNone,        ///< no correction: the image stays as rendered
    kFrame,       ///< exposure and colour of a training image
    kController,  ///< exposure and colour predicted from the image itself; neutral if the model has no controller
};

/// The photometric correction of a view. A model without PPISP ignores it.
struct IspView {
    IspMode mode = IspMode::kNone;
    int frame = -1;            ///< kFrame: index of the training image; -1 = neutral
    int camera = 0;            ///< index of the camera, which determines vignetting and response
    float prior_exposure = 0;  ///< kController: known exposure in stops, e.g. from EXIF
};

/// One view to render. Sent between ranks as raw bytes.
struct RenderRequest {
    CameraParams<float> camera;
    Vec3<float> background{0, 0, 0};
    RenderMode mode = RenderMode::kFull;
    IspView isp = {};
    /// Whether to render median colours: the colour of the one Gaussian at which the transmittance of a pixel falls to
    /// 1/2 or below, or 0 if it stays above, instead of the sum of all colours (docs/math/rasterizer.md#median).
    bool median = false;
};

/// The image of one view.
struct RenderedImage {
    int width = 0, height = 0;
    std::vector<float> rgb;    ///< planar (3,H,W), not clamped
    std::vector<float> alpha;  ///< (H,W), 1 - final transmittance
};

/// The learning rates of a step.
struct StepRates {
    double groups[kNumGroups] = {};
    std::vector<double> residuals;  ///< rate per residual column, if the model has several; else empty
    double shared = 0;              ///< rate of the shared weights
    /// Rate of PPISP's parameters in `step`, or of the controller's weights in `distill`. 0 leaves them unchanged.
    double isp = 0;
    float noise = 0;  ///< SGLD factor 5e5*lr_means; 0 = no noise
    /// A mean at a distance d > `extent` from `center`, both in frame units, has its rate multiplied by (d /
    /// extent)^far.
    Vec3<float> center{0, 0, 0};
    float extent = 1, far = 0;

    /// Multiplies all rates and the noise.
    void scale(double factor) {
        for (double& rate : groups) rate *= factor;
        for (double& rate : residuals) rate *= factor;
        shared *= factor, isp *= factor, noise *= float(factor);
    }
};

/// One optimizer step on one view. Other ranks get only the fields listed in visit_step (kernels/ranks/message.cpp):
/// add new fields there, too.
struct StepRequest {
    CameraParams<float> camera;
    Vec3<float> background{0, 0, 0};
    TargetImage target;
    std::shared_ptr<const void> pixels;  ///< owner of the target's memory; null: the caller keeps it until return
    IspView isp = {};                    ///< kFrame or kNone for `step`, kController for `distill`
    std::int64_t iteration = 0;          ///< 0-based
    std::uint64_t seed = 0;
    LossWeights loss;
    StepRates rates;
    /// Whether to add up the norm of the 2-D mean gradient for ADC, for Gaussians that touch a tile.
    bool gather_gradient_stats = false;
    bool only_visible = false;  ///< whether to defer updates of Gaussians that touch no tile (GaussianState::last_step)
    bool gather_camera_gradient = false;  ///< whether to compute the gradient of the camera (take_camera_gradients)
};

/// The gradient of the loss of one view of a step, without regularisers, by its camera.
struct ViewCameraGradient {
    ImageId id;  ///< of the target
    CameraGradient<double> gradient;
};

/// Returns the step on training view `view`. The memory it points to stays valid until the next call.
using StepSource = std::function<StepRequest(std::size_t view)>;

/// The statistics of the steps since the last call of `take_stats`.
struct StepStats {
    std::int64_t steps = 0;
    double loss = 0, l1 = 0, ssim = 0;  ///< values of the last step
    std::int64_t num_instances = 0;     ///< Gaussian-tile pairs of the last step
    /// Number of gradients left out because they were not finite, summed over the steps: all of them (Gaussians, shared
    /// weights and PPISP), and only the ones common to all ranks (shared weights and PPISP).
    std::int64_t num_nonfinite_gradients = 0, num_nonfinite_common = 0;
    std::int64_t consecutive_skips = 0;  ///< steps in a row skipped because the loss was not finite
};

/// The part of a model to copy.
enum class Download {
    kAll,         ///< everything, with Adam moments and statistics
    kParameters,  ///< parameters of Gaussians, shared weights and PPISP
    kBases,       ///< raw base colours only
    kPpisp,       ///< PPISP only, with its moments
};

/// Memory held by a backend on its device.
struct MemoryUse {
    struct Row {
        std::string what;
        std::int64_t bytes = 0;
        std::string item;  ///< unit that the bytes grow with: "Gaussian", "instance", "pixel", "image"
        double items = 0;
    };
    std::vector<Row> rows;
    std::int64_t bytes = 0, peak = 0;
};

/// Options of an engine. Options marked "CUDA" have no effect on the CPU.
struct EngineOptions {
    /// Whether all sums have a fixed order, which makes results bitwise repeatable on one device, but is slower.
    bool deterministic = false;
    bool separate_appearance = false;                   ///< CUDA: separate kernels for appearance, for comparison
    std::int64_t image_budget = std::int64_t(4) << 30;  ///< bytes of training images that a device may keep
    double min_alpha = kMinAlpha;                       ///< fragments with a lower alpha are skipped; >= kMinAlpha
    double min_transmittance = kMinTransmittance;       ///< a pixel is finished once its transmittance is lower
    /// CUDA: whether frames read residual parameters rounded to half precision.
    bool half_residuals = false;
    /// CUDA: whether both Adam moments of a residual parameter share 32 bits (bfloat16).
    bool packed_moments = false;
};

/// Parameters of the MCMC strategy.
struct McmcParams {
    std::int64_t cap = 1000000;
    float min_opacity = 0.005f;
    double growth = 1.05;
    bool by_gradient = false;  ///< whether growth prefers Gaussians whose colour has large gradients
    std::int64_t room = 0;     ///< number of Gaussians to allocate on a device, if above the cap
};

/// Parameters of the ADC strategy.
struct AdcParams {
    float grad_threshold = 0.0002f;
    float extent = 1;              ///< scene extent E, frame units
    float dense_fraction = 0.01f;  ///< smaller Gaussians are cloned, larger ones split: threshold dense_fraction*E
    float min_opacity = 0.005f;
    bool prune_large = false;     ///< whether to remove Gaussians larger than 0.1*E
    std::int64_t cap = 0;         ///< 0 = unlimited; growth stops at the cap
    bool may_remove_all = false;  ///< whether removing every Gaussian is allowed: other ranks may have some
};

/// Lowers opacities for ADC: raw opacity <- min(raw, logit 0.01). The moments of the opacity group become 0.
struct OpacityReset {};

/// Sorts all rows by the Morton code of the mean (docs/math/densification.md#morton-order).
struct MortonOrder {};

/// One change to the set of Gaussians by the rule of a strategy, or to their order.
struct DensifyRequest {
    std::variant<McmcParams, AdcParams, OpacityReset, MortonOrder> rule;
    std::int64_t iteration = 0;
    std::uint64_t seed = 0;
};

struct DensifyStats {
    std::int64_t relocated = 0, added = 0, cloned = 0, split = 0, pruned = 0, count = 0;
};

/// Selects Gaussians with a parameter that is not finite or is beyond kLargestParameter
/// (kernels/densify/rows_device.h).
struct NonFiniteRows {};

/// Selects Gaussians that can never be seen: opacity below 1/255 or |q|^2 < 1e-8.
struct InvisibleRows {};

/// Value of the residuals of a model for some training views (Backend::residual_scores).
struct ResidualScores {
    /// Increase of half the squared error, summed over pixels and channels, if a Gaussian loses its residual. One value
    /// per row, 0 for a Gaussian without a residual.
    std::vector<float> worth;
    std::vector<float> mean_base;  ///< (n,3) base colours that reproduce the mean colour over the views
};

/// Selects all rows except these, which are in ascending order.
struct AllBut {
    std::vector<std::uint32_t> rows;
};

/// The Gaussians to remove.
using PruneRequest = std::variant<NonFiniteRows, InvisibleRows, AllBut>;

struct PruneStats {
    std::int64_t removed = 0;
    /// The number of Gaussians with broken values per group, for NonFiniteRows.
    std::array<std::int64_t, kNumGroups> by_group{};
};

/// Time and work of one stage, summed over the steps of a pass.
struct StageCost {
    std::string stage;
    double seconds = 0;
    double items = 0;
    std::string item;       ///< name of an item, e.g. "pixel x Gaussian"
    double bytes = 0;       ///< least memory traffic of all items
    double operations = 0;  ///< least arithmetic of all items, in single-precision instructions (an FMA is one)
    std::string note;       ///< reason for exceeding these bounds, if known; may be empty
    bool evaluates_appearance = false;  ///< whether the stage evaluates the appearance model
};

}  // namespace gs
