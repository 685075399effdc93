// SPDX-License-Identifier: Apache-2.0
// What a device does for the model that it holds. Backend (kernels/ranks/backend.h) drives it, alone or with those of
// other ranks; nothing else does.
//
// Of a training over several ranks each holds a part of the Gaussians (docs/math/ranks.md). An engine projects its own
// for the ranks that render a view, renders views of splats from all ranks, and takes the step of its own Gaussians by
// the sums that come back. Where it holds the whole model, render(), step() and distill() do all of that at once.
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

/// What is always the same of an engine.
struct EngineTraits {
    std::string device;              ///< "CUDA, NVIDIA H200"
    DeviceStream* stream = nullptr;  ///< of the device on which it computes; null: the host
    /// The number of passes over the same steps by which stages are timed. On a device a mark costs a few microseconds,
    /// by which all that follows comes later; so each pass marks the end of one stage.
    int stage_passes = 1;
    Ceilings (*ceilings)() = nullptr;  ///< measures the peak bandwidth and arithmetic rate of the machine
};

/// The rows of a model and PPISP, on a device.
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
    /// Replaces PPISP and leaves the Gaussians unchanged.
    virtual void upload_ppisp(const PpispState& state) = 0;

    virtual DensifyStats densify(const DensifyRequest& request) = 0;
    virtual PruneStats prune(const PruneRequest& request) = 0;
    /// Does what Backend::keep_residuals says.
    virtual void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) = 0;

  protected:
    ~DeviceModel() = default;
};

/// Views of the engine's own Gaussians, or of splats from all ranks.
class ViewRenderer {
  public:
    /// Renders a view into `out` and waits for it: of the engine's own Gaussians if `splats` is null.
    virtual void render(const RenderRequest& request, const SplatParts* splats, RenderedImage& out) = 0;
    /// Begins to compute the splats of the engine's Gaussians that touch a tile of the view: for a step, or for a
    /// frame, which may read residuals in half precision. A device is at work on it until end_projection().
    virtual void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) = 0;
    /// Writes the splats of the projection that was begun, the only one, and begins the report on the view unless that
    /// is null. With `room` it does not wait for the device: it writes that many splats; those beyond it are left out,
    /// and what they leave free reaches no pixel.
    virtual void end_projection(ProjectedView& out, std::optional<std::size_t> room, ViewReport* report) = 0;
    /// Makes room for the next view that is rendered for a step, of `splats` splats, and returns places for `placed`
    /// splats, also of other views, and for as many sums. Unless the view is the `first` one, sums of the last are on
    /// their way; unless it is the `last` one, there are projections before update_rows().
    virtual ScratchPlaces room_for_splats(const CameraParams<float>& camera, std::size_t splats, std::size_t placed,
                                          bool first, bool last) = 0;
    /// Does what order_on_host() says, where the arrays lie.
    virtual void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                               DeviceArray<WireSplat>& out) = 0;

    /// Returns half the squared error of a view, weighted by its mask.
    virtual double half_squared_error(const StepRequest& request, const SplatParts& splats) = 0;
    /// Computes what a view adds to the score of each splat (Backend::scores). Unlike those of a step, these sums lie
    /// in the host's memory, in double: Shard adds up views.
    virtual void scores_of_splats(const RenderRequest& request, const SplatParts& splats,
                                  const SumParts<double>& scores) = 0;
    /// Computes what a view says of the residual of each splat (Backend::residual_scores), in the host's memory.
    virtual void residual_sums_of_splats(const StepRequest& request, const SplatParts& splats,
                                         const SumParts<ResidualSplatSums>& sums) = 0;
    /// Does for the engine's own Gaussians what Backend::time_frames says, if it can leave the images on the device;
    /// empty otherwise.
    virtual std::optional<double> time_frames(const std::vector<RenderRequest>&, int) { return {}; }
    /// Does for the engine's own Gaussians what Backend::scores says, if that is faster than by splats; empty
    /// otherwise.
    virtual std::optional<std::vector<float>> scores(const std::vector<RenderRequest>&) { return {}; }
    /// The same of Backend::residual_scores.
    virtual std::optional<ResidualScores> residual_scores(std::size_t, const StepSource&) { return {}; }

  protected:
    ~ViewRenderer() = default;
};

/// Optimizer steps.
class StepEngine {
  public:
    /// Takes a step of the engine's own Gaussians, as Backend::step does.
    virtual void step(const StepRequest& request) = 0;
    /// Trains a controller as Backend::distill does, on a view of the engine's own Gaussians if `splats` is null.
    virtual void distill(const StepRequest& request, const SplatParts* splats) = 0;
    /// Returns the statistics of the steps known to be done since the last call, and what was left out in them.
    virtual StepStats take_stats() = 0;

    /// Begins to compute the loss of a view and the gradient sums of each splat, which mean nothing if the loss is not
    /// finite. Adds the gradient of the view's PPISP to `isp_gradient` (PpispState::size()) where it learns. `sums` may
    /// lie in the memory of `splats`: they are resized after the last use of these. Adds the loss to `report`.
    virtual void loss_of_splats(const StepRequest& request, const SplatParts& splats,
                                const SumParts<SplatSums<float>>& sums, std::vector<float>& isp_gradient,
                                ViewReport* report) = 0;
    /// Decides on the step whose views `reports` are on, (ranks, views) by all ranks (decide_step), and takes the step
    /// of the engine's Gaussians if that says so, on the mean gradient of `views`, of which `projected` and `sums` hold
    /// the splats that were projected and what was computed of them. Counts it in any case. A device decides when it
    /// comes there, may still be at work when the function returns, and takes part in no step from one on that has to
    /// be repeated until take_back(). `num_gaussians` counts those of all ranks. Writes the gradient of the shared
    /// weights by the engine's Gaussians, shared_row() values, which mean nothing in a step that is not taken.
    virtual void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                             const std::vector<ProjectedView>& projected,
                             const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                             DeviceArray<float>& shared_gradient) = 0;
    /// Takes the step of the shared weights after update_rows(), on the same condition. `shared_gradients` (ranks,
    /// shared_row()) are those of all ranks, which are added up in their order.
    virtual void update_shared_weights(const std::vector<StepRequest>& views,
                                       const DeviceArray<float>& shared_gradients) = 0;
    /// Waits for the oldest decision that was not read yet, and returns the reports on which it was made. `ids` are the
    /// targets' of its views, of which rank k modulo the number of ranks has rendered the k-th. Where that is `rank`,
    /// this engine, it has room for the view's instances then.
    virtual std::vector<ViewReport> read_reports(const std::vector<ImageId>& ids, int rank) = 0;
    /// Takes back the counts of the steps from the oldest on that has to be repeated, on `num_views` views together.
    virtual void take_back(std::int64_t num_views) = 0;

    /// Begins a pass of timing, of which pass 0 forgets what was measured before. Without a pass ends the timing, and
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
