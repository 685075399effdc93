// SPDX-License-Identifier: Apache-2.0
// One model in training, on one device or on the devices of several ranks (docs/math/ranks.md). Code above this header
// does not depend on the number of ranks.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/engine.h"
#include "kernels/ranks/shard.h"

namespace gs {

/// The model as seen by rank 0, which makes all decisions. Each call is sent to the other ranks, which follow it, and
/// does rank 0's part of it. A single rank that trains on one view per step passes whole steps to its engine.
class Backend {
  public:
    /// Takes rank 0's own engine, and trains on `views_per_step` views per step. `ranks` must outlive the object; null:
    /// there is only one rank.
    explicit Backend(std::unique_ptr<Engine> engine, Communicator* ranks = nullptr, int views_per_step = 1);
    /// Sends the other ranks the end of the calls, or closes the connection if a call failed halfway.
    ~Backend();

    /// Describes the backend and its device in one line.
    std::string describe() const;
    /// Returns the maximum number of views per step.
    int views_per_step() const { return views_per_step_; }
    /// Returns whether rank 0 needs the pixels of view k of a step. Other ranks read the pixels of the other views by
    /// their target's id.
    bool needs_pixels(int k) const { return k % ranks_.size() == 0; }

    /// Replaces the whole model. Moments that `state` lacks become 0.
    void upload(const Gaussians& state);
    /// Returns the model with its moments, as a checkpoint needs it, or without them, as it is shown: then the 3-D
    /// filter is part of the scales and opacities (merge_smoothing).
    Gaussians download(bool with_moments);
    std::int64_t count() const;
    /// Returns the number K of Gaussians that have a residual. They are the first rows of the model.
    std::int64_t num_residuals() const;
    void set_active_degree(int degree);
    /// Sets the variance of the 3-D filter of each Gaussian by the sharpest of these cameras that sees it
    /// (docs/math/rasterizer.md#antialiasing). Does nothing for a model without the filter.
    void update_smoothing(const std::vector<CameraParams<float>>& cameras);
    /// Replaces PPISP and leaves the Gaussians unchanged.
    void upload_ppisp(const PpispState& state);
    /// Returns PPISP without moments.
    PpispState download_ppisp();

    /// Renders a view into `out` and waits for it.
    void render(const RenderRequest& request, RenderedImage& out);
    /// Returns the number of views that render_all renders at the same time.
    int views_at_once() const { return ranks_.size(); }
    /// Renders views as `render` does, and waits for all.
    void render_all(const std::vector<RenderRequest>& views, std::vector<RenderedImage>& out);
    /// Takes one optimizer step on the mean gradient of 1 to views_per_step() views. All must have the rates of the
    /// first. May return before the step is done. The memory that the requests point to is no longer used after return,
    /// except memory that they own (StepRequest::pixels).
    void step_on(const std::vector<StepRequest>& views);
    void step(const StepRequest& request) { step_on({request}); }
    /// Takes one optimizer step of the controller of the view's camera; everything else is frozen. The loss is computed
    /// on the view as corrected by the controller, without opacity, scale and PPISP terms. Needs a model with
    /// controllers.
    void distill(const StepRequest& request);
    /// Returns the statistics of the completed steps. On a device they lag up to three steps behind unless
    /// `synchronize` was called. With several ranks the gradients left out are counted only after `synchronize`. Throws
    /// DeviceError once a rank is lost.
    StepStats take_stats();
    /// Waits for all steps, and returns the gradients of the cameras of those since the last call that were to gather
    /// them, in the order of the steps (StepRequest::gather_camera_gradient). Steps whose loss was not finite have
    /// none.
    std::vector<ViewCameraGradient> take_camera_gradients();
    /// Waits until all steps are done.
    void synchronize();

    DensifyStats densify(const DensifyRequest& request);
    /// Returns the dependence of the images of `views` on each Gaussian (docs/math/densification.md#pruning-by-score):
    /// the sum over views and pixels of (dI/dG)^2. I is the sum of the channels of the composited colour, G the
    /// Gaussian's value at the pixel. One value per row, finite or +infinity; 0 for a Gaussian that no view shows.
    /// Mode, median and isp of `views` are ignored.
    std::vector<float> scores(const std::vector<RenderRequest>& views);
    /// Returns the value of each residual for `num_views` training views (kernels/blend/residual_score.h).
    ResidualScores residual_scores(std::size_t num_views, const StepSource& step_on);
    /// Returns half the squared error of a training view, weighted by its mask, summed over pixels and channels.
    double half_squared_error(const StepRequest& view);
    /// Removes the residual of all Gaussians without a mark (0 or 1, one per row). If `bases` (n,3) is not empty, the
    /// Gaussians that lose a residual get its base colours. Afterwards rows with a residual come first; each kind keeps
    /// its order.
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases);
    /// Removes Gaussians with a parameter that is not finite or is beyond kLargestParameter
    /// (kernels/densify/rows_device.h), and counts the broken rows per group.
    PruneStats prune_nonfinite();
    /// Removes Gaussians that can never be seen: opacity below 1/255 or |q|^2 < 1e-8. Returns their number.
    std::int64_t prune_invisible();
    /// Removes the share `ratio` (0..1) of Gaussians with the lowest scores() in `views`, and all Gaussians whose score
    /// equals the highest of these. At least 1 % of all Gaussians stay (kernels/densify/densify.h). Returns the number
    /// removed.
    std::int64_t prune_lowest_scores(const std::vector<RenderRequest>& views, double ratio);
    /// Sorts all rows by the Morton code of the mean (docs/math/densification.md#morton-order).
    void morton_sort();

    MemoryUse memory() { return engine_->memory(); }
    // Measurements that training does not need. Those that name no rank are of rank 0.
    /// Returns the mean seconds per frame over `repeats` rounds through all views, after one warm-up round. With a
    /// single rank the images stay on the device.
    double time_frames(const std::vector<RenderRequest>& views, int repeats);
    int stage_passes() const { return engine_->traits().stage_passes; }
    /// Begins a pass of stage timing (EngineTraits); pass 0 discards earlier measurements. Without a pass number ends
    /// the timing, and returns the costs per stage of the steps of one pass.
    std::vector<StageCost> measure_stages(std::optional<int> pass) { return engine_->measure_stages(pass); }
    Ceilings measure_ceilings();
    /// Returns rank 0's costs of the steps since the last call of take_costs() or take_reports().
    RankCosts take_costs() { return shard_.take_costs(); }
    /// Returns the reports of all ranks, by rank.
    std::vector<RankReport> take_reports();
    /// Measures the connection between the ranks (measure_link).
    LinkSpeed measure_connection();

  private:
    /// Calls a member function of Shard with these arguments on all ranks. After a failure nothing more is sent.
    template <auto kFunction, class... Arguments> auto on_all(const Arguments&... arguments);
    void finish_steps();
    void deal_anew_if_uneven();

    SingleRank single_;
    Communicator& ranks_;
    const std::unique_ptr<Engine> engine_;
    const int views_per_step_;
    const bool alone_;  ///< whether there is one rank with one view per step
    Shard shard_;
    bool all_steps_done_ = false;  ///< whether synchronize() was called after the last step
    bool lost_ = false;
    bool controllers_differ_ = false;  ///< whether the controllers were trained, which only rank 0 does
};

/// Follows the calls of rank 0 with this rank's `engine` until they end. `targets` loads the images of the views that
/// this rank renders.
void follow(Communicator& ranks, Engine& engine, const TargetSource& targets);

}  // namespace gs
