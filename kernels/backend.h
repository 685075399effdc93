// SPDX-License-Identifier: Apache-2.0
// What lib/ drives: one training model on one device. Nothing above this header knows which backend runs.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "kernels/core/ceilings.h"
#include "kernels/requests.h"

namespace gs {

/// What a backend measures of itself. Training does without it.
class BackendTimer {
  public:
    /// Mean seconds of a frame over `repeats` rounds through all views, after one round to warm up. Images stay on the device.
    virtual double time_frames(const std::vector<RenderRequest>& views, int repeats) = 0;
    /// Stages are timed only while this is on (the marks between stages cost a few microseconds each).
    virtual void measure_stages(bool on) = 0;
    virtual std::vector<StageCost> take_stage_costs() = 0;
    /// Measures the peak bandwidth and arithmetic rate of this backend's machine.
    virtual Ceilings measure_ceilings() = 0;

  protected:
    ~BackendTimer() = default;
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

    virtual MemoryUse memory() = 0;
    /// The clock of this backend's device.
    virtual BackendTimer& timer() = 0;

    virtual DensifyStats densify(const DensifyRequest& request) = 0;
    /// ADC: raw opacity <- min(raw, logit 0.01), zero moments of the opacity group.
    virtual void reset_opacity() = 0;
    /// How much the images of `views` depend on each Gaussian (docs/math/densification.md#pruning-by-score): the sum
    /// over views and pixels of (dI/dG)^2, I the sum of the channels of the composited colour, G the Gaussian's value
    /// at the pixel. By row, finite or +infinity; 0 of what no view shows.
    virtual std::vector<float> scores(const std::vector<RenderRequest>& views) = 0;
    /// Removes the Gaussians that `request` names.
    virtual PruneStats prune(const PruneRequest& request) = 0;
    /// Orders all rows by the Morton code of the mean (docs/math/densification.md#morton-order).
    virtual void morton_sort() = 0;
};

/// Backend on the CPU for one appearance model. Throws UsageError for an unknown model.
std::unique_ptr<Backend> make_cpu_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

/// Backend on the current CUDA device. Throws UsageError for an unknown model, DeviceError without CUDA (cuda_device.h).
std::unique_ptr<Backend> make_cuda_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

}  // namespace gs
