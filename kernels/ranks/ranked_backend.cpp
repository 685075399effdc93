// SPDX-License-Identifier: Apache-2.0
// The commands of rank 0, and how the other ranks follow them.
#include "kernels/ranks/ranked_backend.h"

#include <algorithm>
#include <exception>

#include "kernels/core/clock.h"
#include "kernels/core/error.h"
#include "kernels/core/process_use.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/mcmc_device.h"
#include "kernels/densify/residual_handles.h"
#include "kernels/ranks/messages.h"

namespace gs {
namespace {

enum class Call : std::uint32_t {
    kEnd,
    kUpload,
    kDownload,
    kSetDegree,
    kUploadPpisp,
    kRender,
    kStep,
    kFinishSteps,
    kTakeNonFinite,
    kDistill,
    kDensify,
    kResetOpacity,
    kScores,
    kResidualScores,
    kSquaredError,
    kPruneNonFinite,
    kPruneInvisible,
    kPruneLowest,
    kMortonSort,
    kReport,
    kMeasureLink
};

/// By how much a rank may have more Gaussians than the mean before all are dealt anew. Fair samples of one model stay
/// far below it; few Gaussians on many ranks do not.
constexpr double kMostUneven = 1.25;

MessageWriter message_of(Call call) {
    MessageWriter message;
    message.put(call);
    return message;
}

// What all ranks do of calls that are more than one function of the worker.

/// Removes the rank's Gaussians that `request` selects by themselves. Returns the statistics of all ranks.
PruneStats prune_rows(Communicator& ranks, RankWorker& worker, const PruneRequest& request) {
    PruneStats all;
    for (const PruneStats& one : all_gather(ranks, worker.backend().prune(request))) {
        all.removed += one.removed;
        for (int g = 0; g < kNumGroups; ++g) all.by_group[g] += one.by_group[g];
    }
    worker.count_rows();
    return all;
}

DensifyStats densify_rows(Communicator& ranks, RankWorker& worker, const DensifyRequest& request,
                          const std::vector<std::int64_t>& shares) {
    DensifyStats all;
    for (const DensifyStats& one : all_gather(ranks, worker.densify(request, shares))) {
        all.relocated += one.relocated, all.added += one.added, all.cloned += one.cloned;
        all.split += one.split, all.pruned += one.pruned, all.count += one.count;
    }
    worker.count_rows();
    return all;
}

RankReport report(RankWorker& worker) {
    return {worker.take_costs(), worker.backend().count(), worker.backend().memory().bytes, resident_bytes()};
}

/// Keeps the marked rows; `marks` is of the whole model on rank 0, empty on the others.
void keep_rows(RankWorker& worker, const std::vector<std::uint8_t>& marks) {
    const std::vector<std::uint8_t> own = worker.scatter_rows(marks);
    std::vector<std::uint32_t> rows;
    for (std::size_t i = 0; i < own.size(); ++i)
        if (own[i]) rows.push_back(std::uint32_t(i));
    worker.backend().shard()->keep_rows(rows);
    worker.count_rows();
}

}  // namespace

RankedBackend::RankedBackend(Communicator& ranks, std::unique_ptr<Backend> own, int views_per_step)
    : ranks_(ranks), own_(std::move(own)), views_per_step_(views_per_step), worker_(ranks, *own_, {}) {}

template <class Fn> auto RankedBackend::on_all(const MessageWriter& command, Fn&& own_part) {
    const struct Guard {
        bool& lost;
        int exceptions = std::uncaught_exceptions();
        ~Guard() { lost = lost || std::uncaught_exceptions() > exceptions; }
    } guard{lost_};
    if (lost_) throw DeviceError("a rank of the training was lost");
    send_to_others(ranks_, command);
    return own_part();
}

template <class Fn> auto RankedBackend::together(const MessageWriter& command, Fn&& own_part) {
    return on_all(command, [&] {
        worker_.finish_steps();
        return own_part();
    });
}

RankedBackend::~RankedBackend() {
    try {
        if (lost_)
            ranks_.abort();  // nobody knows what the others wait for
        else
            together(message_of(Call::kEnd), [] {});
    } catch (const Error&) {  // a rank that is lost ends by itself
    }
}

void RankedBackend::finish_steps() {
    if (worker_.has_unfinished_steps()) together(message_of(Call::kFinishSteps), [] {});
}

std::string RankedBackend::describe() const {
    return std::to_string(ranks_.size()) + " ranks, each " + own_->describe();
}

void RankedBackend::upload(const Gaussians& state) {
    together(message_of(Call::kUpload), [&] {
        // The parts go one by one, so that no more than two are in memory besides the model.
        for (int r = 1; r < ranks_.size(); ++r) {
            MessageWriter message;
            put(message, dealt_part(state, ranks_.size(), r));
            send_to(ranks_, r, message);
        }
        worker_.upload(dealt_part(state, ranks_.size(), 0));
    });
}

Gaussians RankedBackend::download(bool with_moments) {
    return together(message_of(Call::kDownload).put(with_moments),
                    [&] { return joined(worker_.download(with_moments)); });
}

void RankedBackend::set_active_degree(int degree) {
    together(message_of(Call::kSetDegree).put(degree), [&] { own_->set_active_degree(degree); });
}

void RankedBackend::upload_ppisp(const PpispState& state) {
    MessageWriter message = message_of(Call::kUploadPpisp);
    put(message, state);
    together(message, [&] { worker_.upload_ppisp(state); });
}

void RankedBackend::render(const RenderRequest& request, RenderedImage& out) {
    std::vector<RenderedImage> images(1);
    std::swap(images[0], out);  // whose memory is used again
    render_all({request}, images);
    out = std::move(images[0]);
}

void RankedBackend::render_all(const std::vector<RenderRequest>& views, std::vector<RenderedImage>& out) {
    if (controllers_differ_ && views.size() > 1) {  // other ranks render some of them
        MessageWriter state = message_of(Call::kUploadPpisp);
        put(state, download_ppisp());
        together(state, [] {});
        controllers_differ_ = false;
    }
    together(message_of(Call::kRender).put(views), [&] { worker_.render(views, out); });
}

void RankedBackend::step_on(const std::vector<StepRequest>& views) {
    MessageWriter message = message_of(Call::kStep);
    put(message, views);
    all_steps_done_ = false;
    const RankWorker::Mark begin = worker_.mark();
    on_all(message, [&] { worker_.step(views); });
    worker_.count_step(begin);
}

void RankedBackend::distill(const StepRequest& request) {
    MessageWriter message = message_of(Call::kDistill);
    put(message, request);
    together(message, [&] { worker_.distill(request); });
    controllers_differ_ = ranks_.size() > 1;
    StepStats& stats = worker_.stats();
    const std::int64_t nonfinite_before = stats.num_nonfinite_gradients;
    stats = own_->take_stats();
    stats.num_nonfinite_gradients += nonfinite_before;
}

StepStats RankedBackend::take_stats() {
    StepStats& stats = worker_.stats();
    StepStats out = stats;
    if (all_steps_done_)  // the question waits for all devices
        out.num_nonfinite_gradients +=
            together(message_of(Call::kTakeNonFinite), [&] { return worker_.take_nonfinite(); });
    stats.steps = 0;
    stats.num_nonfinite_gradients = 0;
    return out;
}

DensifyStats RankedBackend::densify(const DensifyRequest& request) {
    const std::int64_t before = count();
    std::vector<std::int64_t> shares(std::size_t(ranks_.size()), 0);
    const auto* adc = std::get_if<AdcParams>(&request.rule);
    if (const auto* mcmc = std::get_if<McmcParams>(&request.rule))
        shares = even_shares(worker_.rows(), mcmc_target(before, *mcmc));
    else if (adc->cap > 0)
        shares = even_shares(worker_.rows(), adc->cap);
    const DensifyStats stats = together(message_of(Call::kDensify).put(request).put(shares),
                                        [&] { return densify_rows(ranks_, worker_, request, shares); });
    deal_anew_if_uneven();
    if (adc && stats.count == 0) throw_nothing_left(*adc, request.iteration, before + stats.cloned + 2 * stats.split);
    return stats;
}

void RankedBackend::reset_opacity() {
    together(message_of(Call::kResetOpacity), [&] { own_->reset_opacity(); });
}

std::vector<float> RankedBackend::scores(const std::vector<RenderRequest>& views) {
    return together(message_of(Call::kScores).put(views),
                    [&] { return worker_.gather_rows_of_all(worker_.scores(views), 1); });
}

std::int64_t RankedBackend::num_residuals() const {
    std::int64_t sum = 0;
    for (const RankRows& r : worker_.rows()) sum += r.num_residuals;
    return sum;
}

ResidualScores RankedBackend::residual_scores(std::size_t num_views, const StepSource& step_on) {
    ResidualScores all;
    const auto batch_on = [&](std::size_t first) {
        std::vector<StepRequest> views(std::min(num_views - first, std::size_t(ranks_.size())));
        // Rank 0 renders the first, whose pixels are gone with the next call of step_on.
        for (std::size_t k = views.size(); k-- > 0;) {
            views[k] = step_on(first + k);
            if (k > 0) views[k].target.u8 = nullptr, views[k].target.f32 = nullptr;
        }
        MessageWriter message;
        put(message, views);
        send_to_others(ranks_, message);
        return views;
    };
    together(message_of(Call::kResidualScores).put(std::uint64_t(num_views)), [&] {
        const ResidualScores own = worker_.residual_scores(num_views, batch_on);
        all.worth = worker_.gather_rows_of_all(own.worth, 1);
        all.mean_base = worker_.gather_rows_of_all(own.mean_base, 3);
    });
    return all;
}

double RankedBackend::squared_error(const StepRequest& view) {
    MessageWriter message = message_of(Call::kSquaredError);
    put(message, view);
    return together(message, [&] { return worker_.squared_error(view); });
}

void RankedBackend::keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) {
    // Rows with a residual come first, each kind in its order: no rank can see that for all.
    Gaussians all = download(true);
    ResidualHandles residuals(all, true);
    residuals.keep(marks, bases);
    residuals.resolve();
    upload(all);
}

PruneStats RankedBackend::prune(const PruneRequest& request) {
    if (const auto* lowest = std::get_if<LowestScores>(&request)) {
        const std::vector<float> values = scores(lowest->views);
        std::vector<std::uint8_t> marks(values.size(), 0);
        for (std::uint32_t row : rows_of_highest_scores(values, lowest->ratio)) marks[row] = 1;
        const std::int64_t before = count();
        together(message_of(Call::kPruneLowest), [&] { keep_rows(worker_, marks); });
        deal_anew_if_uneven();
        return {before - count(), {}};
    }
    const bool non_finite = std::holds_alternative<NonFiniteRows>(request);
    const PruneStats stats = together(message_of(non_finite ? Call::kPruneNonFinite : Call::kPruneInvisible),
                                      [&] { return prune_rows(ranks_, worker_, request); });
    deal_anew_if_uneven();
    return stats;
}

void RankedBackend::deal_anew_if_uneven() {
    std::int64_t most = 0;
    for (const RankRows& r : worker_.rows()) most = std::max(most, r.count);
    if (double(most) > kMostUneven * double(count()) / ranks_.size() + 1) upload(download(true));
}

void RankedBackend::morton_sort() {
    together(message_of(Call::kMortonSort), [&] { own_->morton_sort(); });
}

std::vector<RankReport> RankedBackend::take_reports() {
    return together(message_of(Call::kReport), [&] { return all_gather(ranks_, report(worker_)); });
}

LinkSpeed RankedBackend::measure_connection() {
    return together(message_of(Call::kMeasureLink), [&] { return measure_link(ranks_, worker_.device()); });
}

double RankedBackend::time_frames(const std::vector<RenderRequest>& views, int repeats) {
    RenderedImage image;
    double start = 0;
    for (int round = 0; round <= repeats; ++round) {
        if (round == 1) start = seconds_now();
        for (const RenderRequest& view : views) render(view, image);
    }
    return (seconds_now() - start) / (double(repeats) * double(views.size()));
}

void follow(Communicator& ranks, Backend& backend, const TargetSource& targets) {
    RankWorker worker(ranks, backend, targets);
    while (true) {
        const RankWorker::Mark begin = worker.mark();
        MessageReader message = receive_from_rank_0(ranks);
        const Call call = message.get<Call>();
        if (call != Call::kStep) worker.finish_steps();
        switch (call) {
            case Call::kEnd:
                return;
            case Call::kFinishSteps:
                break;
            case Call::kUpload: {
                MessageReader part = receive_from_rank_0(ranks);
                worker.upload(get_gaussians(part));
                break;
            }
            case Call::kDownload:
                worker.download(message.get<bool>());
                break;
            case Call::kSetDegree:
                backend.set_active_degree(message.get<int>());
                break;
            case Call::kUploadPpisp:
                worker.upload_ppisp(get_ppisp(message));
                break;
            case Call::kRender: {
                std::vector<RenderRequest> views;
                std::vector<RenderedImage> nowhere;
                message.get(views);
                worker.render(views, nowhere);
                break;
            }
            case Call::kStep:
                worker.step(get_steps(message));
                worker.count_step(begin);
                break;
            case Call::kTakeNonFinite:
                worker.take_nonfinite();
                break;
            case Call::kDistill:
                worker.distill(get_step(message));
                break;
            case Call::kDensify: {
                const auto request = message.get<DensifyRequest>();
                std::vector<std::int64_t> shares;
                message.get(shares);
                densify_rows(ranks, worker, request, shares);
                break;
            }
            case Call::kResetOpacity:
                backend.reset_opacity();
                break;
            case Call::kScores: {
                std::vector<RenderRequest> views;
                message.get(views);
                worker.gather_rows_of_all(worker.scores(views), 1);
                break;
            }
            case Call::kResidualScores: {
                const ResidualScores own = worker.residual_scores(message.get<std::uint64_t>(), [&](std::size_t) {
                    MessageReader batch = receive_from_rank_0(ranks);
                    return get_steps(batch);
                });
                worker.gather_rows_of_all(own.worth, 1);
                worker.gather_rows_of_all(own.mean_base, 3);
                break;
            }
            case Call::kSquaredError:
                worker.squared_error(get_step(message));
                break;
            case Call::kPruneNonFinite:
                prune_rows(ranks, worker, NonFiniteRows{});
                break;
            case Call::kPruneInvisible:
                prune_rows(ranks, worker, InvisibleRows{});
                break;
            case Call::kPruneLowest:
                keep_rows(worker, {});
                break;
            case Call::kMortonSort:
                backend.morton_sort();
                break;
            case Call::kReport:
                all_gather(ranks, report(worker));
                break;
            case Call::kMeasureLink:
                measure_link(ranks, worker.device());
                break;
        }
    }
}

}  // namespace gs
