// SPDX-License-Identifier: Apache-2.0
// Projects the rank's Gaussians for all views, renders the rank's views, and takes the rank's part of a step.
#include "kernels/ranks/rank_worker.h"

#include <algorithm>
#include <cmath>

#include "kernels/core/clock.h"
#include "kernels/core/error.h"
#include "kernels/ranks/messages.h"

namespace gs {
namespace {

/// Returns a seed for the rank, so that no two ranks draw the same numbers for their rows.
std::uint64_t rank_seed(std::uint64_t seed, int rank) { return seed + std::uint64_t(rank) * 0x9E3779B97F4A7C15ull; }

Shard& shard_of(Backend& backend) {
    if (Shard* shard = backend.shard()) return *shard;
    throw UsageError("a training over several ranks is not possible on this device: " + backend.describe());
}

/// Nothing, for views whose splats have no sums.
struct NoSums {};

std::vector<CameraParams<float>> cameras_of(const std::vector<StepRequest>& views) {
    std::vector<CameraParams<float>> cameras;
    for (const StepRequest& view : views) cameras.push_back(view.camera);
    return cameras;
}

}  // namespace

RankWorker::RankWorker(Communicator& ranks, Backend& backend, TargetSource targets)
    : ranks_(ranks), backend_(backend), shard_(shard_of(backend)), targets_(std::move(targets)) {}

template <class Out, class In> void RankWorker::exchange(const Out& out, const In& in) {
    const double start = seconds_now();
    for (std::size_t r = 0; r < out.size(); ++r)
        if (int(r) != ranks_.rank()) costs_.bytes += double(out[r].size());
    ranks_.exchange(out, in);
    costs_.waiting_seconds += seconds_now() - start;
}

void RankWorker::bring_target(StepRequest& request) const {
    if (!request.target.u8 && !request.target.f32) request.target = targets_(request);
}

template <class Sum, class Fn>
void RankWorker::render_views(const std::vector<CameraParams<float>>& cameras, RenderMode mode,
                              std::vector<std::vector<Sum>>& sums, Fn&& view) {
    const std::size_t num_views = cameras.size(), num_ranks = std::size_t(ranks_.size());
    projected_.resize(std::max(projected_.size(), num_views));
    sums.resize(num_views);
    std::vector<std::int64_t> own_counts(num_views);
    for (std::size_t k = 0; k < num_views; ++k) {
        shard_.project(cameras[k], mode, projected_[k]);
        own_counts[k] = std::int64_t(projected_[k].splats.size());
    }
    const double start = seconds_now();
    const auto counts = all_gather(ranks_, own_counts);  // by rank, by view
    costs_.waiting_seconds += seconds_now() - start;
    for (std::size_t first = 0; first < num_views; first += num_ranks) {
        const std::size_t mine = first + std::size_t(ranks_.rank());
        const bool renders = mine < num_views;
        std::vector<ConstBytes> out(num_ranks);
        std::vector<Bytes> in(num_ranks);
        std::vector<std::size_t> begin(num_ranks + 1, 0);  // of each rank's splats in splats_
        for (std::size_t r = 0; r < num_ranks; ++r) {
            begin[r + 1] = begin[r] + (renders ? std::size_t(counts[r][mine]) : 0);
            if (first + r < num_views) out[r] = bytes_of(projected_[first + r].splats);
        }
        splats_.resize(begin[num_ranks]);
        const auto part = [&](auto& values, std::size_t r) {
            return std::span(values).subspan(begin[r], begin[r + 1] - begin[r]);
        };
        for (std::size_t r = 0; r < num_ranks; ++r) in[r] = std::as_writable_bytes(part(splats_, r));
        exchange(out, in);
        if constexpr (std::is_same_v<Sum, NoSums>) {
            if (renders) view(mine);
        } else {
            std::vector<Sum> computed;
            if (renders) view(mine, computed);
            computed.resize(splats_.size());
            for (std::size_t r = 0; r < num_ranks; ++r) {
                out[r] = std::as_bytes(part(computed, r));
                in[r] = {};
                if (first + r >= num_views) continue;
                sums[first + r].resize(projected_[first + r].splats.size());
                in[r] = room_of(sums[first + r]);
            }
            exchange(out, in);
        }
    }
}

void RankWorker::upload(const Gaussians& part) {
    backend_.upload(part);
    isp_size_ = part.ppisp.size();
    count_rows();
}

void RankWorker::upload_ppisp(const PpispState& state) {
    backend_.upload_ppisp(state);
    isp_size_ = state.size();
}

void RankWorker::count_rows() {
    rows_ = all_gather(ranks_, RankRows{backend_.count(), backend_.num_residuals()});
    num_gaussians_ = 0;
    for (const RankRows& r : rows_) num_gaussians_ += r.count;
}

std::vector<Gaussians> RankWorker::download(bool with_moments) {
    MessageWriter message;
    put(message, backend_.download(with_moments));
    const auto sizes = all_gather(ranks_, std::uint64_t(message.bytes().size()));
    std::vector<std::vector<std::byte>> received(sizes.size());
    std::vector<ConstBytes> out(sizes.size());
    std::vector<Bytes> in(sizes.size());
    out[0] = message.bytes();
    if (ranks_.rank() == 0)
        for (std::size_t r = 0; r < sizes.size(); ++r) received[r].resize(sizes[r]), in[r] = received[r];
    ranks_.exchange(out, in);
    std::vector<Gaussians> parts;
    if (ranks_.rank() > 0) return parts;
    for (auto& bytes : received) {
        MessageReader reader(std::move(bytes));
        parts.push_back(get_gaussians(reader));
    }
    return parts;
}

void RankWorker::render(const RenderRequest& request, RenderedImage& out) {
    std::vector<std::vector<NoSums>> none;
    render_views({request.camera}, request.mode, none,
                 [&](std::size_t) { shard_.render_splats(splats_, request, out); });
}

StepStats RankWorker::step(std::vector<StepRequest> views) {
    const double start = seconds_now();
    const RankCosts before = std::exchange(costs_, {});  // without what was exchanged for other calls since
    for (StepRequest& view : views) view.seed = rank_seed(view.seed, ranks_.rank());
    std::vector<ViewLoss> losses(views.size());
    std::vector<float> isp_gradient(isp_size_, 0.0f);
    render_views(cameras_of(views), RenderMode::kFull, sums_, [&](std::size_t k, auto& sums) {
        bring_target(views[k]);
        losses[k] = shard_.loss_of_splats(splats_, views[k], sums, isp_gradient);
    });
    const auto all_losses = all_gather(ranks_, losses);
    StepStats stats;
    stats.steps = 1;
    const double mean = 1 / double(views.size());
    for (std::size_t k = 0; k < views.size(); ++k) {
        const ViewLoss& one = all_losses[k % all_losses.size()][k];
        stats.loss += mean * one.loss, stats.l1 += mean * one.l1, stats.ssim += mean * one.ssim;
        stats.num_instances += one.num_instances;
    }
    stats.consecutive_skips = std::isfinite(stats.loss) ? 0 : 1;
    if (stats.consecutive_skips) {
        shard_.count_step(views);
    } else {
        std::vector<float> shared = shard_.update_rows(views, projected_, sums_, num_gaussians_);
        shared.push_back(float(shard_.take_nonfinite()));
        sum_over_ranks(ranks_, shared);
        stats.num_nonfinite_gradients = std::int64_t(shared.back());
        shared.pop_back();
        for (float& gradient : isp_gradient) gradient *= float(mean);
        sum_over_ranks(ranks_, isp_gradient);
        shard_.update_common(views, shared, isp_gradient);
        stats.num_nonfinite_gradients += shard_.take_nonfinite();  // on all ranks the same
    }
    const RankCosts now = std::exchange(costs_, before);
    costs_.bytes += now.bytes, costs_.waiting_seconds += now.waiting_seconds;
    costs_.seconds += seconds_now() - start;
    ++costs_.steps;
    return stats;
}

void RankWorker::distill(const StepRequest& request) {
    std::vector<std::vector<NoSums>> none;
    render_views({request.camera}, RenderMode::kFull, none,
                 [&](std::size_t) { shard_.distill_splats(splats_, request); });
}

double RankWorker::squared_error(const StepRequest& request) {
    std::vector<std::vector<NoSums>> none;
    double error = 0;
    render_views({request.camera}, RenderMode::kFull, none,
                 [&](std::size_t) { error = shard_.squared_error_of_splats(splats_, request); });
    return error;
}

std::vector<float> RankWorker::scores(const std::vector<RenderRequest>& views) {
    std::vector<double> totals(std::size_t(backend_.count()), 0.0);
    const std::size_t batch = std::size_t(ranks_.size());
    std::vector<std::vector<double>> sums;
    for (std::size_t first = 0; first < views.size(); first += batch) {
        const std::size_t size = std::min(batch, views.size() - first);
        std::vector<CameraParams<float>> cameras;
        for (std::size_t k = 0; k < size; ++k) cameras.push_back(views[first + k].camera);
        render_views(cameras, RenderMode::kFull, sums, [&](std::size_t k, auto& of_view) {
            shard_.scores_of_splats(splats_, views[first + k], of_view);
        });
        for (std::size_t k = 0; k < size; ++k)
            for (std::size_t i = 0; i < sums[k].size(); ++i) totals[projected_[k].rows[i]] += sums[k][i];
    }
    return {totals.begin(), totals.end()};
}

ResidualScores RankWorker::residual_scores(const std::vector<StepRequest>& views,
                                           const std::function<TargetImage(std::size_t view)>& target) {
    std::vector<ResidualSums> totals(std::size_t(backend_.num_residuals()), ResidualSums{});
    const std::size_t batch = std::size_t(ranks_.size());
    std::vector<std::vector<ResidualSplatSums>> sums;
    for (std::size_t first = 0; first < views.size(); first += batch) {
        std::vector<StepRequest> some(views.begin() + first, views.begin() + std::min(views.size(), first + batch));
        render_views(cameras_of(some), RenderMode::kFull, sums, [&](std::size_t k, auto& of_view) {
            some[k].target = target(first + k);
            shard_.residuals_of_splats(splats_, some[k], of_view);
        });
        for (std::size_t k = 0; k < some.size(); ++k) shard_.add_residual_sums(projected_[k], sums[k], totals);
    }
    return shard_.residual_scores_of_rows(totals);
}

DensifyStats RankWorker::densify(DensifyRequest request, const std::vector<std::int64_t>& shares) {
    const std::int64_t share = shares[std::size_t(ranks_.rank())];
    request.seed = rank_seed(request.seed, ranks_.rank());
    if (auto* mcmc = std::get_if<McmcParams>(&request.rule)) {
        mcmc->cap = share;  // all of it at once: how much growth there is has been decided for all ranks
        mcmc->growth = double(share) / double(std::max<std::int64_t>(1, backend_.count())) + 1;
    } else {
        auto& adc = std::get<AdcParams>(request.rule);
        if (adc.cap > 0) adc.cap = std::max<std::int64_t>(1, share);
        adc.may_remove_all = true;
    }
    return backend_.densify(request);
}

std::vector<float> RankWorker::gather_rows_of_all(const std::vector<float>& values, int width) {
    std::vector<std::vector<float>> all(rows_.size());
    std::vector<ConstBytes> out(rows_.size());
    std::vector<Bytes> in(rows_.size());
    out[0] = bytes_of(values);
    if (ranks_.rank() == 0)
        for (std::size_t r = 0; r < all.size(); ++r) {
            all[r].resize(std::size_t(rows_[r].count) * width);
            in[r] = room_of(all[r]);
        }
    ranks_.exchange(out, in);
    std::vector<float> joined;
    if (ranks_.rank() > 0) return joined;
    for (const DealtRow& place : row_order(rows_)) {
        const auto from = all[std::size_t(place.rank)].begin() + std::ptrdiff_t(place.row) * width;
        joined.insert(joined.end(), from, from + width);
    }
    return joined;
}

std::vector<std::uint8_t> RankWorker::scatter_rows(const std::vector<std::uint8_t>& values) {
    std::vector<std::vector<std::uint8_t>> all(rows_.size());
    std::vector<ConstBytes> out(rows_.size());
    std::vector<Bytes> in(rows_.size());
    if (ranks_.rank() == 0) {
        for (std::size_t r = 0; r < all.size(); ++r) all[r].resize(std::size_t(rows_[r].count));
        auto from = values.begin();
        for (const DealtRow& place : row_order(rows_)) all[std::size_t(place.rank)][place.row] = *from++;
        for (std::size_t r = 0; r < all.size(); ++r) out[r] = bytes_of(all[r]);
    }
    std::vector<std::uint8_t> own(std::size_t(rows_[std::size_t(ranks_.rank())].count));
    in[0] = room_of(own);
    ranks_.exchange(out, in);
    return own;
}

}  // namespace gs
