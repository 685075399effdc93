// SPDX-License-Identifier: Apache-2.0
// The calls of rank 0, and the loop in which the other ranks follow them.
#include "kernels/ranks/backend.h"

#include <algorithm>
#include <exception>
#include <tuple>
#include <type_traits>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/mcmc_device.h"
#include "kernels/densify/residual_handles.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/ranks/message.h"
#include "kernels/splat/smoothing.h"

namespace gs {
namespace {

// Functions that all ranks call together. To add one, write the function and add it to `Calls`; its arguments are sent
// by their types.

/// Writes one argument. A pointer refers to data that only rank 0 has: it is not sent, and is null on the other ranks.
template <class T> void put_argument(MessageWriter& to, const T& value) {
    if constexpr (std::is_pointer_v<T>)
        return;
    else if constexpr (requires { put(to, value); })
        put(to, value);
    else
        to.put(value);
}

template <class T> T get_argument(MessageReader& from) {
    T value{};
    if constexpr (std::is_pointer_v<T>)
        return value;
    else if constexpr (requires { get(from, value); })
        get(from, value);
    else
        from.get(value);
    return value;
}

/// Table of the member functions of `Object`, numbered in their order.
template <class Object, auto... kFunctions> class CallTable {
  public:
    template <auto kFunction> static constexpr std::uint32_t number() {
        std::uint32_t k = 0;
        const bool found = ((std::is_same_v<Tag<kFunctions>, Tag<kFunction>> || (++k, false)) || ...);
        return found ? k : throw "the function is not in the table";  // fails to compile in a constant expression
    }
    /// Reads the arguments of the function with that number, and calls it.
    static void call(std::uint32_t number, Object& object, MessageReader& message) {
        constexpr void (*kCalls[])(Object&, MessageReader&) = {&read_and_call<kFunctions>...};
        if (number >= sizeof...(kFunctions)) throw DataError("a message between ranks asks for an unknown function");
        kCalls[number](object, message);
    }

  private:
    template <auto kFunction> struct Tag {};

    template <auto kFunction> static void read_and_call(Object& object, MessageReader& message) {
        call_with(kFunction, object, message);
    }
    template <class Result, class... Arguments>
    static void call_with(Result (Object::*function)(Arguments...), Object& object, MessageReader& message) {
        // Braces make the arguments be read in order.
        std::tuple<std::decay_t<Arguments>...> arguments{get_argument<std::decay_t<Arguments>>(message)...};
        std::apply([&](auto&... values) { (object.*function)(values...); }, arguments);
    }
};

/// All functions that the ranks run together.
using Calls =
    CallTable<Shard, &Shard::upload, &Shard::upload_ppisp, &Shard::download, &Shard::set_active_degree,
              &Shard::update_smoothing, &Shard::render, &Shard::step, &Shard::finish_steps, &Shard::take_nonfinite,
              &Shard::take_camera_gradients, &Shard::distill, &Shard::half_squared_error, &Shard::scores,
              &Shard::residual_scores, &Shard::densify, &Shard::prune_nonfinite, &Shard::prune_invisible,
              &Shard::keep_rows, &Shard::morton_sort, &Shard::take_reports, &Shard::measure_connection>;
constexpr std::uint32_t kStep = Calls::number<&Shard::step>(), kEnd = 0xffffffff;

/// Largest ratio of a rank's number of Gaussians to the mean before all are dealt anew. Fair samples of one model stay
/// far below it; few Gaussians on many ranks do not.
constexpr double kMostUneven = 1.25;

}  // namespace

Backend::Backend(std::unique_ptr<Engine> engine, Communicator* ranks, int views_per_step)
    : ranks_(ranks ? *ranks : single_),
      engine_(std::move(engine)),
      views_per_step_(views_per_step),
      alone_(ranks_.size() == 1 && views_per_step == 1),
      shard_(ranks_, *engine_, {}) {}

template <auto kFunction, class... Arguments> auto Backend::on_all(const Arguments&... arguments) {
    const struct Guard {
        bool& lost;
        int exceptions = std::uncaught_exceptions();
        ~Guard() { lost = lost || std::uncaught_exceptions() > exceptions; }
    } guard{lost_};
    constexpr std::uint32_t kNumber = Calls::number<kFunction>();
    if (ranks_.size() > 1) {
        if (lost_) throw DeviceError("a rank of the training was lost");
        MessageWriter message;
        message.put(kNumber);
        (put_argument(message, arguments), ...);
        send_to_others(ranks_, message);
    }
    if (kNumber != kStep) shard_.finish_steps();
    return (shard_.*kFunction)(arguments...);
}

void follow(Communicator& ranks, Engine& engine, const TargetSource& targets) {
    Shard shard(ranks, engine, targets);
    while (true) {
        const Shard::CostsSoFar begin = shard.costs_so_far();
        MessageReader message = receive_from_rank_0(ranks);
        const auto call = message.get<std::uint32_t>();
        if (call != kStep) shard.finish_steps();
        if (call == kEnd) return;
        Calls::call(call, shard, message);
        if (call == kStep) shard.count_step(begin);
    }
}

Backend::~Backend() {
    try {
        if (lost_) {
            ranks_.abort();  // the other ranks may wait for anything
        } else {
            if (ranks_.size() > 1) send_to_others(ranks_, MessageWriter().put(kEnd));
            shard_.finish_steps();
        }
    } catch (const Error&) {  // a lost rank ends by itself
    }
}

void Backend::finish_steps() {
    if (shard_.has_unfinished_steps()) on_all<&Shard::finish_steps>();
}

std::string Backend::describe() const {
    const std::string& device = engine_->traits().device;
    return ranks_.size() == 1 ? device : std::to_string(ranks_.size()) + " ranks, each " + device;
}

// --- the model ------------------------------------------------------------------------------------------------------

void Backend::upload(const Gaussians& state) { on_all<&Shard::upload>(&state); }

Gaussians Backend::download(bool with_moments) {
    Gaussians whole;
    on_all<&Shard::download>(with_moments, &whole);
    if (!with_moments) merge_smoothing(whole);
    return whole;
}

std::int64_t Backend::count() const { return ranks_.size() == 1 ? engine_->counts().count : shard_.num_gaussians(); }

std::int64_t Backend::num_residuals() const {
    if (ranks_.size() == 1) return engine_->counts().num_residuals;
    std::int64_t sum = 0;
    for (const RowCounts& rank : shard_.rows()) sum += rank.num_residuals;
    return sum;
}

void Backend::set_active_degree(int degree) { on_all<&Shard::set_active_degree>(degree); }

void Backend::update_smoothing(const std::vector<CameraParams<float>>& cameras) {
    on_all<&Shard::update_smoothing>(cameras);
}

void Backend::upload_ppisp(const PpispState& state) { on_all<&Shard::upload_ppisp>(state); }

PpispState Backend::download_ppisp() {
    finish_steps();
    PpispState state = engine_->download(Download::kPpisp).ppisp;
    drop_moments(state);
    return state;
}

// --- views ----------------------------------------------------------------------------------------------------------

void Backend::render(const RenderRequest& request, RenderedImage& out) {
    if (ranks_.size() == 1) {
        finish_steps();
        return engine_->render(request, nullptr, out);
    }
    std::vector<RenderedImage> images(1);
    std::swap(images[0], out);  // reuses its memory
    render_all({request}, images);
    out = std::move(images[0]);
}

void Backend::render_all(const std::vector<RenderRequest>& views, std::vector<RenderedImage>& out) {
    if (ranks_.size() == 1) {
        out.resize(views.size());
        for (std::size_t k = 0; k < views.size(); ++k) render(views[k], out[k]);
        return;
    }
    if (controllers_differ_ && views.size() > 1) {  // other ranks render some of the views
        upload_ppisp(download_ppisp());
        controllers_differ_ = false;
    }
    on_all<&Shard::render>(views, &out);
}

double Backend::half_squared_error(const StepRequest& view) { return on_all<&Shard::half_squared_error>(view); }

std::vector<float> Backend::scores(const std::vector<RenderRequest>& views) { return on_all<&Shard::scores>(views); }

ResidualScores Backend::residual_scores(std::size_t num_views, const StepSource& step_on) {
    return on_all<&Shard::residual_scores>(std::uint64_t(num_views), &step_on);
}

double Backend::time_frames(const std::vector<RenderRequest>& views, int repeats) {
    finish_steps();
    if (ranks_.size() == 1)
        if (const auto seconds = engine_->time_frames(views, repeats)) return *seconds;
    RenderedImage image;
    double start = 0;
    for (int round = 0; round <= repeats; ++round) {
        if (round == 1) start = seconds_now();
        for (const RenderRequest& view : views) render(view, image);
    }
    return (seconds_now() - start) / (double(repeats) * double(views.size()));
}

Ceilings Backend::measure_ceilings() {
    synchronize();
    return engine_->traits().ceilings();
}

// --- steps ----------------------------------------------------------------------------------------------------------

void Backend::step_on(const std::vector<StepRequest>& views) {
    all_steps_done_ = false;
    const Shard::CostsSoFar begin = shard_.costs_so_far();
    if (alone_)
        engine_->step(views.front());
    else
        on_all<&Shard::step>(views);
    shard_.count_step(begin);
}

void Backend::distill(const StepRequest& request) {
    if (ranks_.size() == 1) {
        finish_steps();
        engine_->distill(request, nullptr);
    } else {
        on_all<&Shard::distill>(request);
        controllers_differ_ = true;
    }
    if (alone_) return;
    StepStats& stats = shard_.stats();
    const std::int64_t nonfinite_before = stats.num_nonfinite_gradients;
    stats = engine_->take_stats();
    stats.num_nonfinite_gradients += nonfinite_before;
}

StepStats Backend::take_stats() {
    if (alone_) return engine_->take_stats();
    StepStats& stats = shard_.stats();
    StepStats out = stats;
    if (all_steps_done_) out.num_nonfinite_gradients += on_all<&Shard::take_nonfinite>();  // waits for all devices
    stats.steps = 0;
    stats.num_nonfinite_gradients = 0;
    return out;
}

std::vector<ViewCameraGradient> Backend::take_camera_gradients() {
    finish_steps();
    return alone_ ? engine_->take_camera_gradients() : on_all<&Shard::take_camera_gradients>();
}

void Backend::synchronize() {
    finish_steps();
    engine_->synchronize();
    all_steps_done_ = true;
}

// --- rows -----------------------------------------------------------------------------------------------------------

DensifyStats Backend::densify(const DensifyRequest& request) {
    const std::int64_t before = count();
    std::vector<std::int64_t> shares(std::size_t(ranks_.size()), 0);
    const auto* adc = std::get_if<AdcParams>(&request.rule);
    if (const auto* mcmc = std::get_if<McmcParams>(&request.rule))
        shares = even_shares(shard_.rows(), mcmc_target(before, *mcmc));
    else if (adc && adc->cap > 0)
        shares = even_shares(shard_.rows(), adc->cap);
    const DensifyStats stats = on_all<&Shard::densify>(request, shares);
    deal_anew_if_uneven();
    if (adc && stats.count == 0 && !adc->may_remove_all)
        throw_nothing_left(*adc, request.iteration, before + stats.cloned + 2 * stats.split);
    return stats;
}

void Backend::keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) {
    if (ranks_.size() == 1) {
        finish_steps();
        engine_->keep_residuals(marks, bases);
        return shard_.count_rows();
    }
    // Rows with a residual come first, and each kind keeps its order. No single rank can do that for all rows.
    Gaussians all = download(true);
    ResidualHandles residuals(all, true);
    residuals.keep(marks, bases);
    residuals.resolve();
    upload(all);
}

PruneStats Backend::prune_nonfinite() {
    const PruneStats stats = on_all<&Shard::prune_nonfinite>();
    deal_anew_if_uneven();
    return stats;
}

std::int64_t Backend::prune_invisible() {
    const std::int64_t removed = on_all<&Shard::prune_invisible>().removed;
    deal_anew_if_uneven();
    return removed;
}

std::int64_t Backend::prune_lowest_scores(const std::vector<RenderRequest>& views, double ratio) {
    const std::vector<float> values = scores(views);
    std::vector<std::uint8_t> marks(values.size(), 0);
    for (std::uint32_t row : rows_of_highest_scores(values, ratio)) marks[row] = 1;
    const std::int64_t before = count();
    on_all<&Shard::keep_rows>(&marks);
    deal_anew_if_uneven();
    return before - count();
}

void Backend::deal_anew_if_uneven() {
    std::int64_t most = 0;
    for (const RowCounts& rank : shard_.rows()) most = std::max(most, rank.count);
    if (ranks_.size() > 1 && double(most) > kMostUneven * double(count()) / ranks_.size() + 1) upload(download(true));
}

void Backend::morton_sort() { on_all<&Shard::morton_sort>(); }

std::vector<RankReport> Backend::take_reports() { return on_all<&Shard::take_reports>(); }

LinkSpeed Backend::measure_connection() { return on_all<&Shard::measure_connection>(); }

}  // namespace gs
