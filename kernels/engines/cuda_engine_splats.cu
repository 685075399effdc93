// SPDX-License-Identifier: Apache-2.0
// The CUDA engine as one rank of a training: projects its Gaussians for others, renders splats of others, and updates
// its Gaussians from the returned sums. Splats and sums are in device memory.
#include <algorithm>
#include <utility>

#include "kernels/base/parallel.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/engines/cuda_engine.h"
#include "kernels/engines/wire_splats_cuda.h"
#include "kernels/loss/loss_cuda.h"
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs {
namespace {

struct IsVisible {
    const std::uint32_t* counts;
    __device__ bool operator()(std::uint32_t i) const { return counts[i] > 0; }
};

constexpr int kSharedBlock = 128;

/// Takes the step of `n` shared weights on the sum of the gradients of all ranks (num_ranks, row), added up in rank
/// order, if *decision is kTake. Adds the number of gradients that are not finite to *left_out.
__global__ void __launch_bounds__(kSharedBlock)
    step_shared_weights(const float* __restrict__ gradients, int num_ranks, int row, int n, float* __restrict__ param,
                        float* __restrict__ m, float* __restrict__ v, AdamStep<float> step, AdamGains<float> gains,
                        const StepDecision* __restrict__ decision, unsigned* __restrict__ left_out) {
    const int k = blockIdx.x * kSharedBlock + threadIdx.x;
    if (k >= n || *decision != StepDecision::kTake) return;
    const float gradient = sum_of_rows(gradients, num_ranks, row, k);
    if (!update_shared(param[k], m[k], v[k], gradient, step, gains)) atomicAdd(left_out, 1u);
}

/// Adds up the gradients of cameras of all ranks (num_ranks, row), `n` values from `first` on, or writes NaN if the
/// step is not taken.
__global__ void keep_cameras(const float* __restrict__ gradients, int num_ranks, int row, int first, int n,
                             const StepDecision* __restrict__ decision, float* __restrict__ out) {
    const int k = blockIdx.x * kSharedBlock + threadIdx.x;
    if (k < n) out[k] = *decision == StepDecision::kTake ? sum_of_rows(gradients, num_ranks, row, first + k) : NAN;
}

/// Adds the loss of a view to the report on it.
__global__ void __launch_bounds__(kLossSumThreads)
    report_view(const StepControl* __restrict__ control, CudaLossSums sums, LossWeights weights, double weight_sum,
                ViewReport* __restrict__ out) {
    const double2 loss = add_up(sums);
    if (threadIdx.x > 0) return;
    out->loss = loss_of_sums(loss.x, loss.y, weights, weight_sum, std::int64_t(control->num_instances));
    out->lacks_instances = control->stopped;
}

constexpr int kDecisionThreads = 128;

/// Decides on a step from all reports on it, unless an earlier step has to be repeated, and copies the reports to the
/// host.
__global__ void __launch_bounds__(kDecisionThreads)
    decide_step_on_device(const ViewReport* __restrict__ reports, int num_reports, StepDecision* __restrict__ decision,
                          ViewReport* __restrict__ on_host) {
    bool skips = false, repeats = *decision == StepDecision::kRepeat;
    for (int k = threadIdx.x; k < num_reports; k += kDecisionThreads) {
        const ViewReport report = reports[k];
        on_host[k] = report;
        skips |= decide_step(report) == StepDecision::kSkip;
        repeats |= decide_step(report) == StepDecision::kRepeat;
    }
    skips = __syncthreads_or(skips), repeats = __syncthreads_or(repeats);
    if (threadIdx.x == 0)
        *decision = repeats ? StepDecision::kRepeat : skips ? StepDecision::kSkip : StepDecision::kTake;
}

RenderRequest view_of(const StepRequest& r) { return {r.camera, r.background, RenderMode::kFull, r.isp}; }

}  // namespace

// --- the rank's Gaussians, for other ranks --------------------------------------------------------------------------

void CudaEngine::begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) {
    // After update_rows() no residual is stale, and later work is on the same stream.
    if (!wire_.is_updating || !in_flight_.empty()) settle();
    const std::int64_t n = model_.count;
    wire_.camera = camera, wire_.for_step = for_step;
    if (n == 0) return;
    lay_out({.layout = Layout::kProjection, .n = n});
    begin_lens(camera, n);
    PreprocessArgs args = for_step ? preprocess_args(camera, mode, {}) : frame_args({camera, {}, mode});
    args.lens_shapes = lens_shapes_;
    args.shared.prepared = model_.shared_prepared.get();
    args.separate = separate_;
    GS_CUDA(cudaMemsetAsync(control_.get(), 0, sizeof(StepControl), stream_));
    kernels_.preprocess(args, splats_, binning_.input(), control_.get(), stream_);
    std::uint32_t* rows = wire_.rows;
    std::int64_t* num_rows = wire_.num_rows.reserve(1);
    const IsVisible visible{binning_.input().counts};
    std::size_t bytes = 0;
    GS_CUDA(select_rows(nullptr, bytes, n, visible, rows, num_rows, stream_));
    GS_CUDA(
        select_rows(wire_.cub.reserve(std::max<std::size_t>(bytes, 1)), bytes, n, visible, rows, num_rows, stream_));
}

void CudaEngine::end_projection(ProjectedView& out, std::optional<std::size_t> known, ViewReport* report) {
    std::size_t room = known.value_or(0);
    if (!known) {
        if (model_.count > 0) room = std::size_t(read_back(wire_.num_rows.get(), stream_));
        wire_.is_updating = false;
    }
    WireSplats to{out.splats.resize(room), nullptr, nullptr, std::int64_t(room), report};
    if (model_.count == 0) {
        out.rows.resize(0), out.places.resize(0);
        if (report) GS_CUDA(cudaMemsetAsync(report, 0, sizeof *report, stream_));
        return;
    }
    if (wire_.for_step) {
        to.places = out.places.resize(num_blocks(model_.count, 32));
        GS_CUDA(cudaMemsetAsync(to.places, 0, out.places.size() * sizeof *to.places, stream_));
    } else {
        to.rows = out.rows.resize(room);
    }
    pack_splats(wire_.rows, wire_.num_rows.get(), preprocess_args(wire_.camera, RenderMode::kFull, {}).params,
                wire_.camera, splats_, lens_shapes_, to, stream_);
}

ScratchPlaces CudaEngine::room_for_splats(const CameraParams<float>& camera, std::size_t splats, std::size_t placed,
                                          bool first, bool last) {
    wire_.placed = std::int64_t(placed);
    const std::size_t projected = bytes_of({.layout = Layout::kProjection, .n = model_.count});
    wire_.splats_from = first ? projected : std::max(projected, wire_.sums_end);
    wire_.sums_from = kernels_.shared.count > 0 ? bytes_of({.layout = Layout::kSharedSums, .n = model_.count}) : 0;
    if (!last) wire_.sums_from = std::max(wire_.sums_from, projected);
    lay_out_view(camera, std::int64_t(splats), true);
    if (placed == 0) return {};
    return {reinterpret_cast<std::byte*>(wire_.splats), reinterpret_cast<std::byte*>(wire_.sums)};
}

void CudaEngine::order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                               DeviceArray<WireSplat>& out) {
    std::vector<SplatsOfRank> parts;
    for (std::size_t r = 0; r < splats.size(); ++r)
        parts.push_back({splats[r]->data(), rows[r].data(), std::int64_t(rows[r].size()), of_ranks[r].num_residuals});
    SplatsOfRank* on_device = wire_.parts.reserve(parts.size());
    device_stream_.copy(on_device, parts.data(), parts.size() * sizeof(SplatsOfRank));
    merge_splats(parts, on_device, out.resize(num_splats(splats)), stream_);
    device_stream_.wait();  // `parts` and `rows` may end with this call
}

// --- views, of splats from all ranks --------------------------------------------------------------------------------

CudaBins CudaEngine::enqueue_forward(const SplatParts& splats, const RenderRequest& r, bool for_backward,
                                     std::int64_t most) {
    const auto fill = [&] {
        const PreprocessArgs args = preprocess_args(r.camera, r.mode, {});
        const WireView view{args.camera, args.width_padded, args.height_padded, args.depth_key,
                            args.cutoffs.inverse_alpha};
        std::int64_t first = 0;
        for (const auto* part : splats) {
            const auto n = std::int64_t(part->size());
            unpack_splats(part->data(), n, first, view, splats_, lens_shapes_, binning_.input(), control_.get(),
                          stream_);
            first += n;
        }
    };
    return enqueue_splats(r.camera, std::int64_t(num_splats(splats)), r.background, for_backward, fill, most);
}

CudaBins CudaEngine::forward_whole(const SplatParts& splats, const RenderRequest& r, bool for_backward) {
    return forward_whole([&] { return enqueue_forward(splats, r, for_backward); });
}

void CudaEngine::loss_of_splats(const StepRequest& r, const SplatParts& splats, const SumParts<SplatSums<float>>& sums,
                                std::vector<float>& isp_gradient, ViewReport* report) {
    const int slot = std::exchange(next_slot_, (next_slot_ + 1) % kInFlight);
    GS_CUDA(cudaEventSynchronize(done_[slot]));
    const DeviceTarget target = images_.get(r.target, slot, stream_);
    lay_out_view(r.camera, std::int64_t(num_splats(splats)), true);
    step_graph_.run(stream_, [&] {
        const CudaBins bins = enqueue_forward(splats, view_of(r), true, forecast_.most(r.target.id));
        enqueue_loss(r, target);
        enqueue_sums_of_splats(r, splats, bins);
        report_view<<<1, kLossSumThreads, 0, stream_>>>(control_.get(), loss_.sums(), r.loss, target.weight_sum,
                                                        report);
        GS_CUDA_LAUNCHED("report_view");
    });
    wire_.placed = 0, wire_.splats_from = wire_.sums_from = 0;
    GS_CUDA(cudaEventRecord(done_[slot], stream_));
    // Sums may overlap the gradient of PPISP.
    if (ppisp_.corrects(r.isp) && r.rates.isp > 0) ppisp_.add_gradient(isp_gradient, stream_);
    for (std::size_t part = 0; part < splats.size(); ++part) sums[part]->resize(splats[part]->size());
    pack_sums_of_splats(sums);
}

void CudaEngine::decide(const DeviceArray<ViewReport>& reports) {
    if (!wire_.decision.get()) GS_CUDA(cudaMemsetAsync(wire_.decision.reserve(1), 0, sizeof(StepDecision), stream_));
    if (wire_.read.empty()) wire_.read.push_back(std::make_unique<PendingDecision>());
    PendingDecision& decision = *wire_.unread.emplace_back(std::move(wire_.read.front()));
    wire_.read.pop_front();
    decision.num_reports = reports.size();
    auto* const on_host = decision.reports.reserve(reports.size() * sizeof(ViewReport));
    decide_step_on_device<<<1, kDecisionThreads, 0, stream_>>>(
        reports.data(), int(reports.size()), wire_.decision.get(), reinterpret_cast<ViewReport*>(on_host));
    GS_CUDA_LAUNCHED("decide_step_on_device");
    GS_CUDA(cudaEventRecord(decision.made, stream_));
    wire_.is_updating = true;
}

std::vector<ViewReport> CudaEngine::read_decision() {
    PendingDecision& oldest = *wire_.unread.front();
    GS_CUDA(cudaEventSynchronize(oldest.made));
    const auto* const first = reinterpret_cast<const ViewReport*>(oldest.reports.get());
    std::vector<ViewReport> reports(first, first + oldest.num_reports);
    wire_.read.push_back(std::move(wire_.unread.front()));
    wire_.unread.pop_front();
    return reports;
}

std::vector<ViewReport> CudaEngine::read_reports(const std::vector<ImageId>& ids, int rank) {
    const std::vector<ViewReport> reports = read_decision();
    const std::size_t num_ranks = reports.size() / std::max<std::size_t>(ids.size(), 1);
    for (const bool lacks : {false, true})  // the room made last stays
        for (std::size_t k = 0; k < ids.size(); ++k) {
            const std::size_t renderer = k % num_ranks;
            const ViewReport& report = reports[renderer * ids.size() + k];
            if ((report.lacks_instances != 0) != lacks) continue;
            forecast_.note(ids[k], report.loss.num_instances);
            if (renderer != std::size_t(rank)) continue;
            if (report.lacks_instances)
                make_room(static_cast<unsigned long long>(report.loss.num_instances));
            else
                adapt_room(report.loss.num_instances);
        }
    return reports;
}

void CudaEngine::take_back(std::int64_t num_views) {
    GS_CUDA(cudaStreamSynchronize(stream_));
    wire_.is_updating = false;
    while (!wire_.unread.empty()) read_decision();
    GS_CUDA(cudaMemsetAsync(wire_.decision.get(), 0, sizeof(StepDecision), stream_));
    GS_CUDA(cudaMemsetAsync(control_.get(), 0, sizeof(StepControl), stream_));
    meta_.step -= num_views;
    lazy_.reset(meta_.step);
}

void CudaEngine::enqueue_sums_of_splats(const StepRequest& r, const SplatParts& splats, const CudaBins& bins) {
    const auto n = std::int64_t(num_splats(splats));
    if (n == 0) return;
    // With a fixed order only splats with an instance are written. Here all splats are read, and a splat that its owner
    // saw at the edge of a tile may have no instance.
    if (options_.deterministic) GS_CUDA(cudaMemsetAsync(sums_, 0, n * sizeof(PackedSums), stream_));
    enqueue_sums(r, n, bins);
}

void CudaEngine::pack_sums_of_splats(const SumParts<SplatSums<float>>& sums) {
    const PackedSums* from = sums_;
    for (DeviceArray<SplatSums<float>>* part : sums) {
        pack_sums(from, std::int64_t(part->size()), part->data(), stream_);
        from += part->size();
    }
}

void CudaEngine::distill_splats(const SplatParts& splats, const StepRequest& r) {
    check_distillation(ppisp_.host(), r.isp);
    forward_whole(splats, view_of(r), true);
    const DeviceTarget target = images_.get(r.target, 0, stream_);
    enqueue_loss(r, target);
    if (r.rates.isp > 0)
        ppisp_.step_controller(image_, r.rates.isp, ppisp_.begin_controller_step(), control_.get(), stream_);
    const StepStatus status = read_status(loss_.sums());
    note_loss(status, r.loss, target.weight_sum);
    stats_.num_nonfinite_gradients += status.num_nonfinite;
}

double CudaEngine::half_squared_error(const StepRequest& r, const SplatParts& splats) {
    forward_whole(splats, view_of(r), true);
    DeviceBuffer<double> error;
    GS_CUDA(cudaMemsetAsync(error.reserve(1), 0, sizeof(double), stream_));
    enqueue_half_squared_error(r, error.get());
    GS_CUDA(cudaStreamSynchronize(stream_));
    return error.download(1)[0];
}

void CudaEngine::scores_of_splats(const RenderRequest& r, const SplatParts& splats, const SumParts<double>& scores) {
    CudaScores sums(std::int64_t(num_splats(splats)), stream_);
    const CudaBins bins = forward_whole(splats, {r.camera, r.background, RenderMode::kFull, r.isp}, false);
    const SlotMap slots = binning_.slots();
    sums.add(bins, splats_, blend_image(r.camera, r.background), options_.deterministic ? &slots : nullptr,
             std::int64_t(statuses_->num_instances));
    const std::vector<float> values = sums.download();
    write_sums(splats, scores, [&](std::int64_t k, double& score) { score = values[std::size_t(k)]; });
}

void CudaEngine::residual_sums_of_splats(const StepRequest& r, const SplatParts& splats,
                                         const SumParts<ResidualSplatSums>& out) {
    const auto n = std::int64_t(num_splats(splats));
    std::vector<SplatSums<float>> gradients, weights;
    if (n > 0) {
        const CudaBins bins = forward_whole(splats, view_of(r), true);
        const TargetImage target = enqueue_half_squared_error(r, nullptr);
        if (ppisp_.corrects(r.isp)) ppisp_.backward(image_, dL_dimage_, stream_);
        DeviceArray<SplatSums<float>> sums(&device_stream_);
        sums.resize(std::size_t(n));
        const auto download_sums = [&](std::vector<SplatSums<float>>& to) {
            enqueue_sums_of_splats(r, splats, bins);
            pack_sums(sums_, n, sums.data(), stream_);
            sums.on_host(to);
        };
        download_sums(gradients);
        blend_.begin_again(stream_);
        write_mask_weights(target, dL_dimage_, stream_);
        download_sums(weights);
    }
    write_sums(splats, out, [&](std::int64_t k, ResidualSplatSums& to) {
        const SplatSums<float>& s = gradients[std::size_t(k)];
        to = {weights[std::size_t(k)].r, {s.r, s.g, s.b}};
    });
}

// --- the step of the rank's Gaussians -------------------------------------------------------------------------------

void CudaEngine::update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                             const std::vector<ProjectedView>& projected,
                             const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                             DeviceArray<float>& shared_gradient) {
    decide(reports);
    wire_.num_gaussians = num_gaussians;
    keep_last_steps(views[0]);
    meta_.step += std::int64_t(views.size());
    lazy_.reset(meta_.step);  // no residual is ever stale
    const std::int64_t n = model_.count, num_residuals = meta_.active_degree > 0 ? model_.num_residuals() : 0;
    const int num_shared = kernels_.shared.count, num_views = int(views.size());
    const bool with_cameras = views[0].gather_camera_gradient;
    const std::size_t row = shared_row(std::size_t(num_shared), with_cameras ? views.size() : 0);
    float* const gradients = shared_gradient.resize(row);
    if (row > 0) GS_CUDA(cudaMemsetAsync(gradients, 0, row * sizeof(float), stream_));
    if (!wire_.left_out.get()) GS_CUDA(cudaMemsetAsync(wire_.left_out.reserve(2), 0, 2 * sizeof(unsigned), stream_));
    if (n == 0) return;
    // The layout ends before the sums that lie in the scratch block (room_for_splats).
    if (num_shared > 0) lay_out({.layout = Layout::kSharedSums, .n = n});
    std::vector<SplatsOfView>& step_views = wire_.host_views[wire_.next_views];
    wire_.next_views = (wire_.next_views + 1) % kInFlight;
    step_views.clear();
    for (std::size_t v = 0; v < views.size(); ++v)
        step_views.push_back({views[v].camera, projected[v].places.data(), sums[v].data()});
    SplatsOfView* on_device = wire_.views.reserve(step_views.size());
    device_stream_.copy(on_device, step_views.data(), step_views.size() * sizeof(SplatsOfView));
    PreprocessArgs args = preprocess_args(views[0].camera, RenderMode::kFull, {});
    args.shared = {model_.shared_prepared.get(), shared_sums_};
    if (with_cameras) {
        camera_sums_.reserve(n, num_views);
        args.camera_rows = camera_sums_.rows();
    }
    kernels_.step_on_views(args, on_device, num_views, arrays_of_step(views[0]),
                           update_args(views[0], meta_.step, num_gaussians, num_views), std::uint32_t(meta_.step),
                           wire_.decision.get(), wire_.left_out.get(), stream_);
    half_residuals_current_ = false;
    // If no residual is shown, the weights have no gradient. If the step is not taken, the rows are not written, and
    // their sum is not used.
    if (num_shared > 0 && num_residuals > 0)
        sum_rows(shared_sums_, int(num_blocks(n, kernels_.shared.gaussians_per_sum)), num_shared, gradients, stream_);
    if (with_cameras) camera_sums_.add_up(n, num_views, gradients + num_shared, stream_);
}

void CudaEngine::update_shared_weights(const std::vector<StepRequest>& views,
                                       const DeviceArray<float>& shared_gradients) {
    const int n = kernels_.shared.count, num_cameras = views[0].gather_camera_gradient ? int(views.size()) : 0;
    const int row = int(shared_row(std::size_t(n), std::size_t(num_cameras)));
    if (row == 0) return;
    const int num_ranks = int(shared_gradients.size()) / row;
    if (num_cameras > 0) {
        constexpr int kSize = CameraGradient<float>::kSize;
        if (wire_.ids_of_cameras.size() + std::size_t(num_cameras) > kMostCameraGradients) collect_camera_gradients();
        float* const out = wire_.of_cameras.reserve(kMostCameraGradients * kSize) + wire_.ids_of_cameras.size() * kSize;
        for (const StepRequest& view : views) wire_.ids_of_cameras.push_back(view.target.id);
        keep_cameras<<<num_blocks(num_cameras * kSize, kSharedBlock), kSharedBlock, 0, stream_>>>(
            shared_gradients.data(), num_ranks, row, n, num_cameras * kSize, wire_.decision.get(), out);
        GS_CUDA_LAUNCHED("keep_cameras");
    }
    if (n == 0) return;
    const UpdateArgs args = update_args(views[0], meta_.step, 1, int(views.size()));
    step_shared_weights<<<num_blocks(n, kSharedBlock), kSharedBlock, 0, stream_>>>(
        shared_gradients.data(), num_ranks, row, n, model_.shared_param.get(), model_.shared_m.get(),
        model_.shared_v.get(), args.shared_step, args.shared_gains, wire_.decision.get(), wire_.left_out.get() + 1);
    GS_CUDA_LAUNCHED("step_shared_weights");
    kernels_.shared.prepare(model_.shared_param.get(), model_.shared_prepared.get(), stream_);
}

void CudaEngine::collect_camera_gradients() {
    constexpr std::size_t kSize = CameraGradient<float>::kSize;
    std::vector<float> numbers(wire_.ids_of_cameras.size() * kSize);
    if (numbers.empty()) return;
    device_stream_.copy(numbers.data(), wire_.of_cameras.get(), numbers.size() * sizeof(float));
    device_stream_.wait();
    for (std::size_t k = 0; k < wire_.ids_of_cameras.size(); ++k) {
        CameraGradient<double> gradient{};
        gradient.for_each([&](int j, double& number) { number = numbers[k * kSize + std::size_t(j)]; });
        if (std::isfinite(gradient.position.x)) camera_gradients_.push_back({wire_.ids_of_cameras[k], gradient});
    }
    wire_.ids_of_cameras.clear();
}

}  // namespace gs
