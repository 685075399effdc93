// SPDX-License-Identifier: Apache-2.0
// Interface of an engine: all operations of a device on the model that it holds. Only Backend (kernels/ranks/backend.h)
// calls it, either alone or together with the engines of other ranks.
//
// In a training over several ranks each rank holds a part of the Gaussians (docs/math/ranks.md). An engine projects its
// own Gaussians for the ranks that render a view, renders views of splats from all ranks, and updates its own Gaussians
// from the sums that the renderers return. If it holds the whole model, render(), step() and distill() do all of that
// at once.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/base/ceilings.h"
#include "kernels/requests.h"
#include "kernels/splat/projected_view.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// Properties of an engine that never change.
struct EngineTraits {
    std::string device;              ///< "CUDA, NVIDIA H200"
    DeviceStream* stream = nullptr;  ///< stream of the device on which it computes; null: the host
    /// Number of passes over the same steps that stage timing needs. A mark on a device costs a few microseconds, which
    /// delays everything after it; so each pass marks the end of one stage only.
    int stage_passes = 1;
    Ceilings (*ceilings)() = nullptr;  ///< measures the peak bandwidth and arithmetic rate of the machine
};

/// The rows of a model and its PPISP state, on a device.
class DeviceModel {
  public:
    virtual MemoryUse memory() = 0;
    /// Waits until all steps are done.
    virtual void synchronize() = 0;

    /// Replaces the whole model. Moments that `state` lacks become 0.
    virtual void upload(const Gaussians& state) = 0;
    virtual Gaussians download(Download what) = 0;
    virtual RowCounts counts() const = 0;
    virtual void set_active_degree(int degree) = 0;
    /// Implements Backend::update_smoothing for the engine's own rows.
    virtual void update_smoothing(const std::vector<CameraParams<float>>& cameras) = 0;
    /// Replaces PPISP and leaves the Gaussians unchanged.
    virtual void upload_ppisp(const PpispState& state) = 0;

    virtual DensifyStats densify(const DensifyRequest& request) = 0;
    virtual PruneStats prune(const PruneRequest& request) = 0;
    /// Implements Backend::keep_residuals for the engine's own rows.
    virtual void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) = 0;

  protected:
    ~DeviceModel() = default;
};

/// Renders views of the engine's own Gaussians, or of splats from all ranks.
class ViewRenderer {
  public:
    /// Renders a view into `out` and waits for it. If `splats` is null, renders the engine's own Gaussians.
    virtual void render(const RenderRequest& request, const SplatParts* splats, RenderedImage& out) = 0;
    /// Begins to compute the splats of the engine's Gaussians that touch a tile of the view. The view is for a step, or
    /// for a frame, which may read residuals in half precision. A device may be busy with it until end_projection().
    virtual void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) = 0;
    /// Writes the splats of the only projection begun, and begins the report on the view unless `report` is null. With
    /// `room` it does not wait for the device: it writes exactly that many splats, drops any further ones, and fills
    /// unused places with splats that reach no pixel.
    virtual void end_projection(ProjectedView& out, std::optional<std::size_t> room, ViewReport* report) = 0;
    /// Makes room for the `splats` splats of the next view rendered for a step. Returns places for `placed` splats,
    /// which may belong to other views, and for as many sums. Unless the view is the `first` one, sums of the previous
    /// view are still in transfer. Unless it is the `last` one, more projections follow before update_rows().
    virtual ScratchPlaces room_for_splats(const CameraParams<float>& camera, std::size_t splats, std::size_t placed,
                                          bool first, bool last) = 0;
    /// Implements order_on_host() in the memory that holds the arrays.
    virtual void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                               DeviceArray<WireSplat>& out) = 0;

    /// Returns half the squared error of a view, weighted by its mask.
    virtual double half_squared_error(const StepRequest& request, const SplatParts& splats) = 0;
    /// Computes the contribution of a view to the score of each splat (Backend::scores). Unlike the sums of a step,
    /// these are double values in host memory, because Shard adds up views.
    virtual void scores_of_splats(const RenderRequest& request, const SplatParts& splats,
                                  const SumParts<double>& scores) = 0;
    /// Computes the contribution of a view to the residual sums of each splat (Backend::residual_scores), in host
    /// memory.
    virtual void residual_sums_of_splats(const StepRequest& request, const SplatParts& splats,
                                         const SumParts<ResidualSplatSums>& sums) = 0;
    /// Implements Backend::time_frames for the engine's own Gaussians if the images can stay on the device; otherwise
    /// returns nothing.
    virtual std::optional<double> time_frames(const std::vector<RenderRequest>&, int) { return {}; }
    /// Implements Backend::scores for the engine's own Gaussians if that is faster than by splats; otherwise returns
    /// nothing.
    virtual std::optional<std::vector<float>> scores(const std::vector<RenderRequest>&) { return {}; }
    /// Implements Backend::residual_scores likewise.
    virtual std::optional<ResidualScores> residual_scores(std::size_t, const StepSource&) { return {}; }

  protected:
    ~ViewRenderer() = default;
};

/// Takes optimizer steps.
class StepEngine {
  public:
    /// Takes a step of the engine's own Gaussians, as Backend::step does.
    virtual void step(const StepRequest& request) = 0;
    /// Trains a controller as Backend::distill does, on a view of the engine's own Gaussians if `splats` is null.
    virtual void distill(const StepRequest& request, const SplatParts* splats) = 0;
    /// Returns the statistics of the steps completed since the last call, including the count of gradients left out.
    virtual StepStats take_stats() = 0;
    /// Waits for all steps, and returns the gradients of the cameras of those since the last call that were to gather
    /// them, in the order of the steps. Steps whose loss was not finite have none.
    virtual std::vector<ViewCameraGradient> take_camera_gradients() = 0;

    /// Begins to compute the loss of a view and the gradient sums of each splat. The sums are meaningless if the loss
    /// is not finite. Adds the gradient of the view's PPISP parameters to `isp_gradient` (PpispState::size()) if they
    /// are trained. `sums` may share the memory of `splats`: they are resized after the last use of the splats. Adds
    /// the loss to `report`.
    virtual void loss_of_splats(const StepRequest& request, const SplatParts& splats,
                                const SumParts<SplatSums<float>>& sums, std::vector<float>& isp_gradient,
                                ViewReport* report) = 0;
    /// Decides whether to take the step (decide_step) from `reports` (ranks, views), the reports of all ranks on its
    /// views. If so, updates the engine's Gaussians by the mean gradient over `views`: `projected` and `sums` hold the
    /// projected splats and their gradient sums. Counts the step in either case. A device decides when it reaches this
    /// point and may still be busy when the function returns. From a step that has to be repeated onwards it skips all
    /// steps until take_back(). `num_gaussians` is the number of Gaussians of all ranks. Writes the engine's part of
    /// the gradients that all ranks share, shared_row() values, which are meaningless if the step is not taken: the
    /// gradients of the shared weights, then those of each view's camera if StepRequest::gather_camera_gradient is set.
    virtual void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                             const std::vector<ProjectedView>& projected,
                             const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                             DeviceArray<float>& shared_gradient) = 0;
    /// Updates the shared weights after update_rows(), on the same condition, and keeps the gradients of the cameras.
    /// `shared_gradients` (ranks, shared_row()) holds the gradients of all ranks, which are added up in rank order.
    virtual void update_shared_weights(const std::vector<StepRequest>& views,
                                       const DeviceArray<float>& shared_gradients) = 0;
    /// Waits for the oldest unread decision, and returns the reports on which it was based. `ids` are the targets of
    /// its views; view k was rendered by rank k modulo the number of ranks. For views that `rank`, this engine's rank,
    /// rendered, makes room for their instances.
    virtual std::vector<ViewReport> read_reports(const std::vector<ImageId>& ids, int rank) = 0;
    /// Subtracts the steps that have to be repeated from the counts, from the oldest such step on. They have
    /// `num_views` views in total.
    virtual void take_back(std::int64_t num_views) = 0;

    /// Begins a pass of stage timing; pass 0 discards earlier measurements. Without a pass number ends the timing, and
    /// returns the costs per stage of the steps of one pass.
    virtual std::vector<StageCost> measure_stages(std::optional<int> pass) = 0;

  protected:
    ~StepEngine() = default;
};

/// One model on one device. Only one thread may use it.
class Engine : public DeviceModel, public ViewRenderer, public StepEngine {
  public:
    virtual ~Engine() = default;
    const EngineTraits& traits() const { return traits_; }

  protected:
    EngineTraits traits_;
};

/// Makes an engine on the CPU for one appearance model. Throws UsageError for an unknown model.
std::unique_ptr<Engine> make_cpu_engine(const AppearanceSpec& appearance, const EngineOptions& options = {});

/// Makes an engine on the current CUDA device. Throws UsageError for an unknown model, and DeviceError without CUDA
/// (cuda_device.h).
std::unique_ptr<Engine> make_cuda_engine(const AppearanceSpec& appearance, const EngineOptions& options = {});

}  // namespace gs
