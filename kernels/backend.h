// SPDX-License-Identifier: Apache-2.0
// The interface that lib/ drives: one training model on one device. Nothing above this header knows which backend runs.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/core/ceilings.h"
#include "kernels/requests.h"

namespace gs {

class Shard;

/// The measurements that a backend takes of itself. Training does not need them.
class BackendTimer {
  public:
    /// Returns the mean seconds of a frame over `repeats` rounds through all views, after one round to warm up. The
    /// images stay on the device.
    virtual double time_frames(const std::vector<RenderRequest>& views, int repeats) = 0;
    /// Returns the number of passes over the same steps by which stages are timed. On a device a mark costs a few
    /// microseconds, by which all that follows comes later; so each pass marks the end of one stage.
    virtual int stage_passes() const { return 1; }
    /// Begins a pass, or ends the timing.
    virtual void measure_stages(std::optional<int> pass) = 0;
    /// Returns the costs per stage of the steps of one pass, since the last call, and starts anew.
    virtual std::vector<StageCost> take_stage_costs() = 0;
    /// Measures the peak bandwidth and arithmetic rate of this backend's machine.
    virtual Ceilings measure_ceilings() = 0;

  protected:
    ~BackendTimer() = default;
};

/// One model under training on one device.
class Backend {
  public:
    virtual ~Backend() = default;
    /// Returns what the backend does for a training over several ranks; null where it does nothing.
    virtual Shard* shard() { return nullptr; }
    /// Returns the most views that a step may have.
    virtual int views_per_step() const { return 1; }
    /// Returns whether view k of a step needs its pixels here. Those of the others are read elsewhere, by the target's
    /// id.
    virtual bool needs_pixels(int) const { return true; }
    /// Takes one optimizer step on the mean gradient of 1 to views_per_step() views, as `step` does of one. All must
    /// have the rates of the first.
    virtual void step_on(const std::vector<StepRequest>& views) { step(views.front()); }
    /// Describes the backend and its device in one line.
    virtual std::string describe() const = 0;

    /// Replaces the whole model. Moments that `state` lacks become 0.
    virtual void upload(const Gaussians& state) = 0;
    virtual Gaussians download(bool with_moments) = 0;
    virtual std::int64_t count() const = 0;
    virtual void set_active_degree(int degree) = 0;
    /// Replaces PPISP and leaves the Gaussians unchanged.
    virtual void upload_ppisp(const PpispState& state) = 0;
    /// Returns PPISP without moments.
    virtual PpispState download_ppisp() = 0;

    /// Renders a view into `out` and waits for it.
    virtual void render(const RenderRequest& request, RenderedImage& out) = 0;
    /// Returns how many views render_all renders at the same time.
    virtual int views_at_once() const { return 1; }
    /// Renders views as `render` does, and waits for all.
    virtual void render_all(const std::vector<RenderRequest>& views, std::vector<RenderedImage>& out) {
        out.resize(views.size());
        for (std::size_t k = 0; k < views.size(); ++k) render(views[k], out[k]);
    }
    /// Takes one optimizer step on one view. It may return before the step is done; the memory that `request` points to
    /// is free again on return, except what it keeps by itself (StepRequest::pixels).
    virtual void step(const StepRequest& request) = 0;
    /// Takes one optimizer step of the controller of the view's camera; everything else is frozen. The loss is that of
    /// the view as the controller corrects it, without opacity, scale and PPISP terms. Needs a model with controllers.
    virtual void distill(const StepRequest& request) = 0;
    /// Returns the statistics of the steps known to be done. On a device these are up to three steps late, unless
    /// `synchronize` was called; several ranks count gradients that were left out only then. Throws DeviceError once a
    /// rank is lost.
    virtual StepStats take_stats() = 0;
    /// Waits until all steps are done.
    virtual void synchronize() = 0;

    virtual MemoryUse memory() = 0;
    /// Returns the timer of this backend's device.
    virtual BackendTimer& timer() = 0;

    virtual DensifyStats densify(const DensifyRequest& request) = 0;
    /// Lowers opacities for ADC: raw opacity <- min(raw, logit 0.01). The moments of the opacity group become 0.
    virtual void reset_opacity() = 0;
    /// Returns how much the images of `views` depend on each Gaussian (docs/math/densification.md#pruning-by-score):
    /// the sum over views and pixels of (dI/dG)^2. I is the sum of the channels of the composited colour, G the
    /// Gaussian's value at the pixel. One value per row, finite or +infinity; 0 for a Gaussian that no view shows.
    virtual std::vector<float> scores(const std::vector<RenderRequest>& views) = 0;
    /// Returns the number K of Gaussians that have a residual. They are the first rows.
    virtual std::int64_t num_residuals() const = 0;
    /// Returns what each residual is worth to `num_views` training views (kernels/blend/residual_score.h).
    virtual ResidualScores residual_scores(std::size_t num_views, const StepSource& step_on) = 0;
    /// Returns half the squared error of a training view, weighted by its mask, summed over pixels and channels.
    virtual double squared_error(const StepRequest& view) = 0;
    /// Takes the residual from the Gaussians without a mark (0 or 1, one per row), and gives those that had one the
    /// base colours `bases` (n,3), if there are any. Rows with a residual come first afterwards, each kind in its
    /// order.
    virtual void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) = 0;
    /// Removes the Gaussians that `request` names.
    virtual PruneStats prune(const PruneRequest& request) = 0;
    /// Sorts all rows by the Morton code of the mean (docs/math/densification.md#morton-order).
    virtual void morton_sort() = 0;
};

/// Makes a backend on the CPU for one appearance model. Throws UsageError for an unknown model.
std::unique_ptr<Backend> make_cpu_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

/// Makes a backend on the current CUDA device. Throws UsageError for an unknown model, and DeviceError without CUDA
/// (cuda_device.h).
std::unique_ptr<Backend> make_cuda_backend(const AppearanceSpec& appearance, const BackendOptions& options = {});

}  // namespace gs
