// SPDX-License-Identifier: Apache-2.0
// The CUDA engine: one stream of steps, with the host running ahead of it. Only .cu files include this header.
//
// The host never waits inside a step, whose kernels are launched as one graph. It does not know the number of instances
// of a view, so a capacity bounds that number, and a forecast sets the part of it that a view is likely to need. A step
// that does not fit changes nothing, and neither do later steps. Up to three steps later the host reads this in the
// step's status, makes room and repeats these steps.
#pragma once

#include <deque>
#include <functional>
#include <limits>

#include "kernels/blend/blend_cuda.h"
#include "kernels/cuda/device_stream_cuda.h"
#include "kernels/densify/densify_cuda.h"
#include "kernels/engine.h"
#include "kernels/engines/images_cuda.h"
#include "kernels/engines/instance_forecast.h"
#include "kernels/engines/model_kernels_cuda.h"
#include "kernels/engines/stage_times_cuda.h"
#include "kernels/engines/wire_splats_cuda.h"
#include "kernels/loss/loss_cuda.h"
#include "kernels/optimizer/lazy_cuda.h"
#include "kernels/ppisp/ppisp_cuda.h"

namespace gs {

/// The report of a step, which the device writes into host memory.
struct StepStatus {
    unsigned long long num_instances, num_pairs;
    double l1_sum, ssim_sum;  ///< over pixels and channels
    unsigned num_visible, num_nonfinite, stopped;
    float of_camera[CameraGradient<float>::kSize];  ///< of the last step that gathered it
};

/// The engine of one model on the current device.
class CudaEngine final : public Engine {
  public:
    CudaEngine(const ModelKernels& kernels, const EngineOptions& options);
    ~CudaEngine() override;

    // model
    MemoryUse memory() override;
    void synchronize() override;
    void upload(const Gaussians& state) override;
    Gaussians download(Download what) override;
    RowCounts counts() const override { return {model_.count, model_.num_residuals()}; }
    void set_active_degree(int degree) override;
    void update_smoothing(const std::vector<CameraParams<float>>& cameras) override;
    void upload_ppisp(const PpispState& state) override;
    DensifyStats densify(const DensifyRequest& request) override;
    PruneStats prune(const PruneRequest& request) override;
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override;

    // views and steps of the engine's own Gaussians
    void render(const RenderRequest& request, const SplatParts* splats, RenderedImage& out) override;
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int repeats) override;
    std::optional<std::vector<float>> scores(const std::vector<RenderRequest>& views) override;
    std::optional<ResidualScores> residual_scores(std::size_t num_views, const StepSource& step_on) override;
    void step(const StepRequest& request) override;
    void distill(const StepRequest& request, const SplatParts* splats) override;
    StepStats take_stats() override;
    std::vector<ViewCameraGradient> take_camera_gradients() override;
    std::vector<StageCost> measure_stages(std::optional<int> pass) override;

    // cuda_engine_splats.cu
    void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) override;
    void end_projection(ProjectedView& out, std::optional<std::size_t> room, ViewReport* report) override;
    ScratchPlaces room_for_splats(const CameraParams<float>& camera, std::size_t splats, std::size_t placed, bool first,
                                  bool last) override;
    void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                       DeviceArray<WireSplat>& out) override;
    double half_squared_error(const StepRequest& request, const SplatParts& splats) override;
    void scores_of_splats(const RenderRequest& request, const SplatParts& splats,
                          const SumParts<double>& scores) override;
    void residual_sums_of_splats(const StepRequest& request, const SplatParts& splats,
                                 const SumParts<ResidualSplatSums>& sums) override;
    void loss_of_splats(const StepRequest& request, const SplatParts& splats, const SumParts<SplatSums<float>>& sums,
                        std::vector<float>& isp_gradient, ViewReport* report) override;
    void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                     const std::vector<ProjectedView>& projected,
                     const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                     DeviceArray<float>& shared_gradient) override;
    void update_shared_weights(const std::vector<StepRequest>& views,
                               const DeviceArray<float>& shared_gradients) override;
    std::vector<ViewReport> read_reports(const std::vector<ImageId>& ids, int rank) override;
    void take_back(std::int64_t num_views) override;

  private:
    /// Largest number of steps with unread status. With three, the device is never idle while the host prepares the
    /// next.
    static constexpr int kInFlight = 3;
    /// Room for the gradients of cameras of steps on splats until the host collects them.
    static constexpr std::size_t kMostCameraGradients = 1024;

    struct Step {
        StepRequest request;  ///< its target holds no pointers; `target` does
        DeviceTarget target;
        ImageId view;                      ///< id of the target
        std::int64_t adam_step = 0;        ///< Adam's step of the Gaussians; 0: they do not change
        std::int64_t isp_step = 0;         ///< step of PPISP's parameters; 0: they do not change
        std::int64_t controller_step = 0;  ///< step of a controller; 0: it does not change
        LazyArgs lazy{};
        int slot = 0;
    };
    /// Data of a step on several views that the host has not read yet.
    struct PendingDecision {
        PendingDecision() { GS_CUDA(cudaEventCreateWithFlags(&made, cudaEventDisableTiming)); }
        ~PendingDecision() { cudaEventDestroy(made); }
        PinnedBuffer reports;
        std::size_t num_reports = 0;
        cudaEvent_t made = nullptr;
    };
    /// Contents of the scratch block. Projections are of a rank's own Gaussians, whose instances other ranks sort; the
    /// sums of the shared weights' gradients belong to a step on several views.
    enum class Layout { kProjection, kFrame, kStep, kSharedSums };
    /// The sizes for which the scratch block is laid out.
    struct Sizes {
        Layout layout = Layout::kFrame;
        std::int64_t n = 0, capacity = 0;
        int width = 0, height = 0;
        std::int64_t placed = 0;  ///< splats stored in the block in wire format, and later their sums
        std::size_t splats_from = 0, sums_from = 0;  ///< smallest offsets of these, in bytes
        bool operator==(const Sizes&) const = default;
    };

    /// Takes all buffers of a layout from the scratch block.
    void take(Carver& c, const Sizes& sizes);
    void lay_out(const Sizes& sizes);
    /// Lays out a view of `n` splats. Reduces the room for instances if there is no memory for more than is needed.
    /// Throws DeviceError if the view is too large.
    void lay_out_view(const CameraParams<float>& camera, std::int64_t n, bool for_backward);
    /// Returns the bytes of the scratch block for these sizes.
    std::size_t bytes_of(const Sizes& sizes);
    /// Lays out a step, and launches its kernels.
    void enqueue(const Step& step);
    /// Enqueues all kernels of a laid-out step, up to its report.
    void enqueue_kernels(const Step& step, const ModelArrays& arrays);
    /// Enqueues the part after the loss: the Gaussians' gradients and their optimizer step.
    void enqueue_gaussians(const Step& step, const PreprocessArgs& args, const CudaBins& bins,
                           const ModelArrays& arrays);
    /// Puts a step in flight. It stays in flight only if it could be enqueued.
    void launch(Step step, const TargetImage& target);
    /// Enqueues the forward pass of `n` splats. Once their buffers are laid out, fill() writes them with all input of
    /// binning. The pass stops if there are more than `most` instances.
    CudaBins enqueue_splats(const CameraParams<float>& camera, std::int64_t n, Vec3<float> background,
                            bool for_backward, const std::function<void()>& fill,
                            std::int64_t most = std::numeric_limits<std::int64_t>::max());
    /// Enqueues the forward pass, and completes `args` with the buffers that it lays out.
    CudaBins enqueue_forward(PreprocessArgs& args, Vec3<float> background, bool for_backward,
                             std::int64_t most = std::numeric_limits<std::int64_t>::max());
    /// Enqueues a view, making room until it fits, and waits. For a view of the engine's own Gaussians, applies all
    /// missed steps first.
    CudaBins forward_whole(const std::function<CudaBins()>& enqueue);
    CudaBins forward_whole(const RenderRequest& request, bool for_backward = false);
    CudaBins forward_whole(const SplatParts& splats, const RenderRequest& request, bool for_backward);
    /// Corrects the image of the last forward pass, if requested, and copies it to the host.
    void finish_image(const RenderRequest& request, RenderedImage& out);
    /// Writes the gradient of half the squared error of a rendered training view to dL_dimage_. Adds that error to
    /// *error, on the device, unless `error` is null. Returns the target.
    TargetImage enqueue_half_squared_error(const StepRequest& r, double* error);
    /// Enqueues the loss of the last rendered view, up to the gradient of the rendered image.
    void enqueue_loss(const StepRequest& r, const DeviceTarget& target);
    /// Computes the sums of the view's `n` splats from dL_dimage_. With a fixed order, sums of splats without an
    /// instance are undefined.
    void enqueue_sums(const StepRequest& r, std::int64_t n, const CudaBins& bins);
    /// Waits, and moves the gradients of the cameras of steps on splats to camera_gradients_.
    void collect_camera_gradients();
    /// Decides on a step on the device, from the reports on its views.
    void decide(const DeviceArray<ViewReport>& reports);
    /// Returns the reports of the oldest unread decision.
    std::vector<ViewReport> read_decision();
    /// Trains a controller on a view of splats from all ranks.
    void distill_splats(const SplatParts& splats, const StepRequest& r);
    /// Enqueues the forward pass of splats received from ranks.
    CudaBins enqueue_forward(const SplatParts& splats, const RenderRequest& request, bool for_backward,
                             std::int64_t most = std::numeric_limits<std::int64_t>::max());
    /// Computes the sums of all received splats from dL_dimage_, including splats in no tile of this device.
    void enqueue_sums_of_splats(const StepRequest& r, const SplatParts& splats, const CudaBins& bins);
    /// Writes these sums in the format for sending.
    void pack_sums_of_splats(const SumParts<SplatSums<float>>& sums);
    /// Records the loss of a step in stats_.
    void note_loss(const StepStatus& status, const LossWeights& weights, double weight_sum);
    /// Starts or stops recording the last step of each Gaussian. All Gaussians are up to date when it starts.
    void keep_last_steps(const StepRequest& r);
    /// Returns the arrays of the model that a step uses.
    ModelArrays arrays_of_step(const StepRequest& r);
    /// Makes the device write the status of the work in the stream, with the loss if it has one.
    void report_to(int slot, const CudaLossSums& loss);
    /// Waits, and returns the status of the work in the stream.
    const StepStatus& read_status(const CudaLossSums& loss = {});
    /// Waits for the oldest step in flight and reads its status. Repeats the steps that were stopped.
    void finish_oldest();
    void make_room(unsigned long long num_instances);
    /// Adapts the room for instances to the number in a training view.
    void adapt_room(std::int64_t num_instances);
    /// Subtracts a step that never took place from the counts.
    void forget(const Step& step);
    /// Discards all steps in flight, none of which has changed anything.
    void abandon_steps();
    PreprocessArgs preprocess_args(const CameraParams<float>& camera, RenderMode mode, const LazyArgs& lazy) const;
    /// Returns the arguments of a frame of up-to-date rows (settle()).
    PreprocessArgs frame_args(const RenderRequest& request);
    BlendImage blend_image(const CameraParams<float>& camera, Vec3<float> background) const;
    /// Prepares the room for the shapes of `n` splats in a view, if it has a lens.
    void begin_lens(const CameraParams<float>& camera, std::int64_t n);
    /// Prepares the rays of the pixels of a view through a lens.
    void find_rays(const CameraParams<float>& camera);
    /// Changes the set of rows by fn(), after all rows are up to date.
    template <class Fn> auto change_rows(Fn fn);
    /// Waits for all steps, then applies the deferred residual steps.
    void settle();

    const ModelKernels kernels_;
    const EngineOptions options_;
    const Cutoffs<float> cutoffs_;
    cudaStream_t stream_ = nullptr;
    LaunchGraph step_graph_;
    CudaDeviceStream device_stream_{stream_};
    CudaModel model_;
    CudaLazyResiduals lazy_;
    DeviceBuffer<__half> half_residuals_;  ///< empty without options.half_residuals
    bool half_residuals_current_ = false;
    CudaPpisp ppisp_;
    Gaussians meta_;  ///< model without count, arrays and PPISP

    Scratch scratch_;
    Sizes sizes_;
    std::int64_t capacity_ = 0, needed_ = 0;  ///< number of instances that fit, and largest number seen
    RecentMost recent_instances_;
    InstanceForecast forecast_;
    int largest_width_ = 0, largest_height_ = 0;  ///< largest sides of any view so far
    PackedSplat* splats_ = nullptr;
    PackedSums* sums_ = nullptr;
    SeparateArgs separate_{};
    SparseRows shared_sums_{};
    PackedLensShape* lens_shapes_ = nullptr;  ///< of the view; null without a lens
    DeviceBuffer<PackedLensShape> lens_shape_room_;
    DeviceBuffer<float4> lens_rays_;
    CameraParams<float> camera_of_rays_{};
    float *image_ = nullptr, *transmittance_ = nullptr, *dL_dimage_ = nullptr;
    CudaBinning binning_;
    CudaBlend blend_;
    CudaLoss loss_;
    CudaCameraSums camera_sums_;
    DeviceBuffer<float> of_camera_;  ///< (kSize) gradient of the camera of a step on one view
    std::vector<ViewCameraGradient> camera_gradients_;

    /// State used only in training over several ranks (cuda_engine_splats.cu).
    struct {
        CameraParams<float> camera{};  ///< camera of the projection begun
        bool for_step = false;
        std::uint32_t* rows = nullptr;  ///< rows of its splats
        DeviceBuffer<std::int64_t> num_rows;
        DeviceBuffer<unsigned char> cub;
        WireSplat* splats = nullptr;  ///< splats in the scratch block
        SplatSums<float>* sums = nullptr;
        std::int64_t placed = 0;  ///< number for the next view to render, as in Sizes
        std::size_t splats_from = 0, sums_from = 0, sums_end = 0;
        DeviceBuffer<SplatsOfView> views;
        DeviceBuffer<SplatsOfRank> parts;  ///< parts of a view whose splats are put in order
        /// Views of the last steps, kept while they are copied. Work enqueued before a decision that was read is done,
        /// and that decision is one of the last two.
        std::vector<SplatsOfView> host_views[kInFlight];
        int next_views = 0;
        DeviceBuffer<float> of_cameras;       ///< (kMostCameraGradients, kSize), NaN for steps that were not taken
        std::vector<ImageId> ids_of_cameras;  ///< of these gradients
        DeviceBuffer<unsigned> left_out;      ///< since take_stats(): Gaussians' gradients, shared weights' gradients
        std::int64_t num_gaussians = 0;       ///< number on all ranks, in the last step
        bool is_updating = false;             ///< whether the device may still be busy with a step
        DeviceBuffer<StepDecision> decision;  ///< decision on the last step, or kRepeat for an earlier one
        std::deque<std::unique_ptr<PendingDecision>> unread, read;  ///< unread decisions in order, and reusable ones
    } wire_;

    DeviceBuffer<StepControl> control_;
    StepStatus* statuses_ = nullptr;  ///< (kInFlight) in pinned memory
    cudaEvent_t done_[kInFlight] = {};
    std::deque<Step> in_flight_;
    int next_slot_ = 0;
    CudaImages images_;
    bool lazily_ = true;  ///< whether the last step updated residuals lazily
    StepStats stats_;
    StageTimes times_;
};

template <class Fn> auto CudaEngine::change_rows(Fn fn) {
    settle();
    sizes_ = {};  // fn may use all of the scratch block
    half_residuals_current_ = false;
    CudaDensify densify(model_, scratch_, stream_);
    const auto result = fn(densify);
    lazy_.reset(meta_.step);
    return result;
}

}  // namespace gs
