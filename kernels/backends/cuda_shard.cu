// SPDX-License-Identifier: Apache-2.0
// The CUDA backend as one rank of a training: projects its Gaussians for others, renders splats of others, and takes
// the step of its Gaussians on the sums that come back. Splats and sums are in the device's memory.
#include <algorithm>
#include <cmath>

#include "kernels/backends/cuda_backend.h"
#include "kernels/backends/wire_splats_cuda.h"
#include "kernels/core/parallel.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs {
namespace {

struct IsVisible {
    const std::uint32_t* counts;
    __device__ bool operator()(std::uint32_t i) const { return counts[i] > 0; }
};

RenderRequest view_of(const StepRequest& r) { return {r.camera, r.background, RenderMode::kFull, r.isp}; }

}  // namespace

// --- the rank's Gaussians, for other ranks --------------------------------------------------------------------------

void CudaBackend::project(const CameraParams<float>& camera, RenderMode mode, bool for_step, ProjectedView& out) {
    // After update_rows() no residual is behind, and what follows is on its stream.
    if (!wire_.is_updating || !in_flight_.empty()) settle();
    const std::int64_t n = model_.count;
    out.splats.resize(0), out.rows.resize(0);
    if (n == 0) return;
    lay_out({n, 1, camera.width, camera.height, false});  // its instances are none of this rank's business
    PreprocessArgs args = for_step ? preprocess_args(camera, mode, {}) : frame_args({camera, {}, mode});
    args.shared = {model_.shared_prepared.get(), nullptr};
    args.separate = separate_;
    GS_CUDA(cudaMemsetAsync(control_.get(), 0, sizeof(StepControl), stream_));
    kernels_.preprocess(args, splats_, binning_.input(), control_.get(), stream_);
    std::uint32_t* rows = wire_.rows.reserve(n);
    std::int64_t* num_rows = wire_.num_rows.reserve(1);
    const IsVisible visible{binning_.input().counts};
    std::size_t bytes = 0;
    GS_CUDA(select_rows(nullptr, bytes, n, visible, rows, num_rows, stream_));
    GS_CUDA(
        select_rows(wire_.cub.reserve(std::max<std::size_t>(bytes, 1)), bytes, n, visible, rows, num_rows, stream_));
    const auto num = std::size_t(read_back(num_rows, stream_));
    wire_.is_updating = false;
    if (num == 0) return;
    rank_device_.copy(out.rows.resize(num), rows, num * sizeof *rows);
    pack_splats(rows, std::int64_t(num), args.params, camera, splats_, out.splats.resize(num), stream_);
}

// --- views, of splats from all ranks --------------------------------------------------------------------------------

CudaBins CudaBackend::enqueue_forward(const RankArray<WireSplat>& splats, const RenderRequest& r, bool for_backward) {
    const auto n = std::int64_t(splats.size());
    return enqueue_splats(r.camera, n, r.background, for_backward, [&] {
        const PreprocessArgs args = preprocess_args(r.camera, r.mode, {});
        unpack_splats(splats.data(), n, args.width_padded, args.height_padded, args.depth_key,
                      args.cutoffs.inverse_alpha, splats_, binning_.input(), control_.get(), stream_);
    });
}

CudaBins CudaBackend::forward_whole(const RankArray<WireSplat>& splats, const RenderRequest& r, bool for_backward) {
    return forward_whole([&] { return enqueue_forward(splats, r, for_backward); });
}

void CudaBackend::render_splats(const RankArray<WireSplat>& splats, const RenderRequest& r, RenderedImage& out) {
    forward_whole(splats, r, false);
    finish_image(r, out);
}

ViewLoss CudaBackend::loss_of_splats(const RankArray<WireSplat>& splats, const StepRequest& r,
                                     RankArray<SplatSums<float>>& sums, std::vector<float>& isp_gradient) {
    const auto n = std::int64_t(splats.size());
    const DeviceTarget target = images_.get(r.target, 0, stream_);
    forward_whole([&] {
        const CudaBins bins = enqueue_forward(splats, view_of(r), true);
        enqueue_loss(r, target);
        enqueue_sums_of_splats(r, n, bins);
        return bins;
    });
    const ViewLoss loss = loss_of(*statuses_, r, target.weight_sum);
    adapt_room(loss.num_instances);
    SplatSums<float>* out = sums.resize(splats.size());  // may overwrite the splats
    if (!std::isfinite(loss.loss)) return loss;
    pack_sums(sums_, n, out, stream_);
    if (ppisp_.corrects(r.isp) && r.isp_rate > 0) ppisp_.add_gradient(isp_gradient, stream_);
    return loss;
}

void CudaBackend::enqueue_sums_of_splats(const StepRequest& r, std::int64_t n, const CudaBins& bins) {
    if (n == 0) return;
    // In a fixed order only splats with an instance are written. Here all are read, and a splat that its owner saw at
    // the edge of a tile may have none.
    if (options_.deterministic) GS_CUDA(cudaMemsetAsync(sums_, 0, n * sizeof(PackedSums), stream_));
    enqueue_sums(r, n, bins);
}

void CudaBackend::distill_splats(const RankArray<WireSplat>& splats, const StepRequest& r) {
    check_distillation(ppisp_.host(), r.isp);
    forward_whole(splats, view_of(r), true);
    const DeviceTarget target = images_.get(r.target, 0, stream_);
    enqueue_loss(r, target);
    if (r.isp_rate > 0)
        ppisp_.step_controller(image_, r.isp_rate, ppisp_.begin_controller_step(), control_.get(), stream_);
    const StepStatus status = read_status();
    note_loss(loss_of(status, r, target.weight_sum));
    stats_.num_nonfinite_gradients += status.num_nonfinite;
}

double CudaBackend::squared_error_of_splats(const RankArray<WireSplat>& splats, const StepRequest& r) {
    forward_whole(splats, view_of(r), true);
    return error_of_view(r);
}

void CudaBackend::scores_of_splats(const RankArray<WireSplat>& splats, const RenderRequest& r,
                                   RankArray<double>& scores) {
    CudaScores sums(std::int64_t(splats.size()), stream_);
    const CudaBins bins = forward_whole(splats, {r.camera, r.background, RenderMode::kFull, r.isp}, false);
    const SlotMap slots = binning_.slots();
    sums.add(bins, splats_, blend_image(r.camera, r.background), options_.deterministic ? &slots : nullptr,
             std::int64_t(statuses_->num_instances));
    const std::vector<float> values = sums.download();
    std::copy(values.begin(), values.end(), scores.resize(values.size()));
}

void CudaBackend::residuals_of_splats(const RankArray<WireSplat>& splats, const StepRequest& r,
                                      RankArray<ResidualSplatSums>& out) {
    ResidualSplatSums* const of_splat = out.resize(splats.size());
    if (splats.size() == 0) return;
    const CudaBins bins = forward_whole(splats, view_of(r), true);
    const TargetImage target = enqueue_error(r, nullptr);
    if (ppisp_.corrects(r.isp)) ppisp_.backward(image_, dL_dimage_, stream_);
    RankArray<SplatSums<float>> sums(&rank_device_);
    sums.resize(splats.size());
    std::vector<SplatSums<float>> copied;
    const auto for_each_sum = [&](auto&& use) {
        enqueue_sums_of_splats(r, std::int64_t(sums.size()), bins);
        pack_sums(sums_, std::int64_t(sums.size()), sums.data(), stream_);
        std::size_t k = 0;
        for (const SplatSums<float>& s : sums.on_host(copied)) use(of_splat[k++], s);
    };
    for_each_sum([](ResidualSplatSums& to, const SplatSums<float>& s) { to.gradient = {s.r, s.g, s.b}; });
    write_weights(target, dL_dimage_, stream_);
    for_each_sum([](ResidualSplatSums& to, const SplatSums<float>& s) { to.weight = s.r; });
}

// --- the step of the rank's Gaussians -------------------------------------------------------------------------------

std::vector<Vec3<float>> CudaBackend::colors_without_residual() {
    synchronize();
    return shown_bases(base_colors(), meta_.appearance.activation);
}

ResidualScores CudaBackend::residual_scores_of_rows(const std::vector<ResidualSums>& totals) {
    return residual_scores_of(totals, meta_.appearance.activation, base_colors());
}

std::vector<float> CudaBackend::update_rows(const std::vector<StepRequest>& views,
                                            const std::vector<ProjectedView>& projected,
                                            const std::vector<RankArray<SplatSums<float>>>& sums,
                                            std::int64_t num_gaussians) {
    synchronize();
    const std::int64_t n = model_.count, num_residuals = meta_.active_degree > 0 ? model_.num_residuals() : 0;
    const int num_shared = kernels_.shared.count, num_views = int(views.size());
    if (n == 0) return std::vector<float>(std::size_t(num_shared), 0.0f);
    if (num_shared > 0) lay_out({n, 1, views[0].camera.width, views[0].camera.height, true});  // for their sums
    std::uint32_t* places = wire_.places.reserve(std::size_t(num_views) * std::size_t(n));
    std::vector<StepView>& step_views = wire_.host_views;
    step_views.clear();
    for (std::size_t v = 0; v < views.size(); ++v) {
        step_views.push_back({views[v].camera, places + std::int64_t(v) * n, sums[v].data()});
        note_places(projected[v].rows.data(), std::int64_t(projected[v].rows.size()), n, places + std::int64_t(v) * n,
                    stream_);
    }
    StepView* on_device = wire_.views.reserve(step_views.size());
    rank_device_.copy(on_device, step_views.data(), step_views.size() * sizeof(StepView));
    if (!wire_.num_nonfinite.get())
        GS_CUDA(cudaMemsetAsync(wire_.num_nonfinite.reserve(1), 0, sizeof(unsigned), stream_));
    PreprocessArgs args = preprocess_args(views[0].camera, RenderMode::kFull, {});
    args.shared = {model_.shared_prepared.get(), shared_sums_};
    const std::int64_t t = meta_.step + num_views;
    kernels_.step_on_views(args, on_device, num_views, arrays_of_step(views[0].gather_gradient_stats),
                           update_args(views[0], t, num_gaussians, num_views), std::uint32_t(t),
                           wire_.num_nonfinite.get(), stream_);
    half_residuals_current_ = false;
    wire_.is_updating = true;
    if (num_shared == 0) return {};  // the host goes on while the device is at work
    // Without a residual that is shown the weights have no gradient.
    const std::int64_t rows_of_sums = num_residuals > 0 ? num_blocks(n, kernels_.shared.gaussians_per_sum) : 0;
    float* shared = wire_.shared.reserve(std::size_t(num_shared));
    sum_rows(shared_sums_, rows_of_sums, num_shared, 1 / float(num_views), shared, stream_);
    synchronize();
    return wire_.shared.download(std::size_t(num_shared));
}

namespace {

bool learns_correction(const CudaPpisp& ppisp, const std::vector<StepRequest>& views) {
    return std::any_of(views.begin(), views.end(),
                       [&](const StepRequest& r) { return ppisp.corrects(r.isp) && r.isp_rate > 0; });
}

}  // namespace

std::int64_t CudaBackend::update_common(const std::vector<StepRequest>& views,
                                        const std::vector<float>& shared_gradient, std::vector<float>& isp_gradient) {
    const int num_views = int(views.size());
    std::int64_t num_nonfinite = 0;
    count_step(views);
    // The shared weights and PPISP are few: the host takes their step.
    if (const auto n = std::size_t(kernels_.shared.count); n > 0) {
        const UpdateArgs args = update_args(views[0], meta_.step, 1, num_views);
        std::vector<float> param = model_.shared_param.download(n), m = model_.shared_m.download(n),
                           v = model_.shared_v.download(n);
        for (std::size_t k = 0; k < n; ++k)
            if (!update_shared(param[k], m[k], v[k], shared_gradient[k], args.shared_step, args.shared_gains))
                ++num_nonfinite;
        model_.shared_param.upload(param), model_.shared_m.upload(m), model_.shared_v.upload(v);
        GS_CUDA(cudaDeviceSynchronize());  // the copies are not on the stream that reads them
        kernels_.shared.prepare(model_.shared_param.get(), model_.shared_prepared.get(), stream_);
    }
    if (!learns_correction(ppisp_, views)) return num_nonfinite;
    PpispState state = ppisp_.download(true);
    if (!step_ppisp(state, isp_gradient, views[0].isp_rate, num_views)) ++num_nonfinite;
    ppisp_.upload(state);
    GS_CUDA(cudaDeviceSynchronize());
    return num_nonfinite;
}

void CudaBackend::count_step(const std::vector<StepRequest>& views) {
    meta_.step += std::int64_t(views.size());
    if (learns_correction(ppisp_, views))
        for (std::size_t v = 0; v < views.size(); ++v) ppisp_.begin_step();
    lazy_.reset(meta_.step);  // no residual is ever behind
}

std::int64_t CudaBackend::take_nonfinite() {
    synchronize();
    if (!wire_.num_nonfinite.get()) return 0;
    const unsigned num_nonfinite = read_back(wire_.num_nonfinite.get(), stream_);
    GS_CUDA(cudaMemsetAsync(wire_.num_nonfinite.get(), 0, sizeof num_nonfinite, stream_));
    return num_nonfinite;
}

void CudaBackend::keep_rows(const std::vector<std::uint32_t>& rows) {
    change_rows([&](CudaDensify& d) { return d.keep_rows(rows), 0; });
}

}  // namespace gs
