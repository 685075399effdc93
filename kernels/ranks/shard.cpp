// SPDX-License-Identifier: Apache-2.0
// Projects the rank's Gaussians for all views, renders the rank's views, and does the rank's part of a step.
#include "kernels/ranks/shard.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/blend/residual_score.h"
#include "kernels/ppisp/ppisp.h"
#include "kernels/ranks/message.h"

namespace gs {
namespace {

/// Returns a seed for the rank, so that no two ranks draw the same random numbers for their rows.
std::uint64_t rank_seed(std::uint64_t seed, int rank) { return seed + std::uint64_t(rank) * 0x9E3779B97F4A7C15ull; }

/// Adds a view's contribution to the residual sums of a rank's Gaussians to `totals` (rows with a residual). `bases`
/// are the colours of all rows without a residual.
void add_view_to(std::vector<ResidualSums>& totals, const ProjectedView& projected,
                 std::span<const ResidualSplatSums> sums, const std::vector<Vec3<float>>& bases) {
    std::vector<WireSplat> copied_splats;
    std::vector<std::uint32_t> copied_rows;
    const auto splats = projected.splats.on_host(copied_splats);
    const auto rows = projected.rows.on_host(copied_rows);
    parallel_for_rows(std::int64_t(sums.size()), [&](std::int64_t k) {
        const std::uint32_t row = rows[k];
        if (row >= totals.size() || !(sums[k].weight > 0)) return;
        const WireSplat& s = splats[k];
        totals[row].add(sums[k].weight, sums[k].gradient, {s.red, s.green, s.blue}, bases[row]);
    });
}

/// Returns the colours of Gaussians with these base colours (n, 3) and no residual.
std::vector<Vec3<float>> shown_bases(const std::vector<float>& bases, ColorActivation activation) {
    std::vector<Vec3<float>> out;
    for (std::size_t i = 0; i < bases.size(); i += 3)
        out.push_back(activate(activation, Vec3<float>{bases[i], bases[i + 1], bases[i + 2]}));
    return out;
}

/// Makes the request own its pixels if they are only lent for a call.
void keep_pixels(StepRequest& request) {
    TargetImage& target = request.target;
    if (request.pixels || (!target.u8 && !target.f32)) return;
    const std::size_t pixels = std::size_t(target.width) * std::size_t(target.height),
                      color_bytes = pixels * std::size_t(target.channels) * (target.u8 ? 1 : sizeof(float)),
                      mask_bytes = target.mask ? pixels : 0;
    const auto kept = std::make_shared<std::vector<std::uint8_t>>(color_bytes + mask_bytes);
    std::memcpy(kept->data(), target.u8 ? static_cast<const void*>(target.u8) : target.f32, color_bytes);
    if (target.mask) std::memcpy(kept->data() + color_bytes, target.mask, mask_bytes);
    if (target.u8)
        target.u8 = kept->data();
    else
        target.f32 = reinterpret_cast<const float*>(kept->data());
    if (target.mask) target.mask = kept->data() + color_bytes;
    request.pixels = kept;
}

/// Returns `num` rounded up so that an array behind it begins at a multiple of 16 bytes.
std::size_t with_alignment(std::size_t num) {
    static_assert(4 * sizeof(WireSplat) % 16 == 0 && 4 * sizeof(SplatSums<float>) % 16 == 0);
    return (num + 3) / 4 * 4;
}

/// Places arrays of values one after another from `at` on, at multiples of 16 bytes, unless `at` is null.
template <class T> auto one_after_another(std::byte* at) {
    return [at](DeviceArray<WireSplat>& array, std::size_t room) mutable {
        array.lie_at(at && room > 0 ? at : nullptr);
        if (at) at += with_alignment(room) * sizeof(T);
    };
}

/// Empty sum, for views whose splats have no sums.
struct NoSum {};

/// Returns the views of `steps`. `reports` are the reports on the views of a step, null for other views.
std::vector<ShownView> shown(const std::vector<StepRequest>& steps, ViewReport* reports) {
    std::vector<ShownView> views;
    for (const StepRequest& step : steps)
        views.push_back({step.camera, RenderMode::kFull, reports != nullptr, step.target.id,
                         reports ? reports + views.size() : nullptr});
    return views;
}

}  // namespace

Shard::Shard(Communicator& ranks, Engine& engine, TargetSource targets)
    : ranks_(ranks),
      engine_(engine),
      device_(engine.traits().stream),
      targets_(std::move(targets)),
      makes_rooms_(device_ && (ranks_.size() == 1 || ranks_.link())),
      ordered_(device_),
      reports_(device_),
      reports_of_all_ranks_(device_),
      shared_(device_),
      shared_of_all_ranks_(device_) {
    for (int r = 0; r < ranks_.size(); ++r) received_.emplace_back(device_);
    sums_.device = device_;
    if (!ranks_.link()) return;
    // The first transfer between two devices takes tenths of a second.
    DeviceArray<float> sent(device_), received(device_);
    sent.assign({0, 0, 0, 0});
    received.resize(4 * received_.size());
    const std::vector<ConstBytes> out(received_.size(), std::as_const(sent).bytes());
    std::vector<Bytes> in;
    for (std::size_t r = 0; r < received_.size(); ++r) in.push_back(received.bytes(4 * r, 4 * r + 4));
    ranks_.exchange(out, in, device_);
    device_->wait();
}

std::size_t Shard::rank_after(std::size_t offset) const {
    return (std::size_t(ranks_.rank()) + offset) % std::size_t(ranks_.size());
}

void Shard::bring_target(StepRequest& request) const {
    if (!request.target.u8 && !request.target.f32) targets_(request);
}

template <class Fn> auto Shard::on_received(Fn&& fn) {
    try {
        return fn();
    } catch (const Error&) {
        if (ranks_.stop_token().stop_requested()) all_gather(ranks_, 0);  // throws
        throw;
    }
}

template <class Sum, class Fn>
void Shard::render_views(const std::vector<ShownView>& views, SumsOfViews<Sum>& sums, Fn&& view) {
    while (projected_.size() < views.size()) projected_.emplace_back(device_);
    for (std::size_t first = 0; first < views.size(); first += received_.size()) {
        const std::size_t mine = first + rank_after(0);
        gather_splats(views, first);
        if constexpr (std::is_same_v<Sum, NoSum>)
            order_by_rows(first, views.size());
        else
            place_sums(views, first, sums);
        if (mine < views.size()) on_received([&] { view(mine); });
        if constexpr (!std::is_same_v<Sum, NoSum>) scatter_sums(first, views, sums);
    }
}

template <class Fn> void Shard::for_places(const std::vector<ShownView>& views, std::size_t first, Fn&& fn) {
    const std::size_t num_ranks = received_.size(), own = rank_after(0), mine = first + own,
                      end = std::min(first + num_ranks, views.size());
    const bool renders = mine < end, projects_more = end < views.size();
    for (std::size_t r = 0; r < num_ranks; ++r)
        if (r != own) fn(received_[r], renders ? room(views[mine].id, r) : 0);
    for (std::size_t k = first; k < end; ++k) {
        // The next view that the rank renders reuses the places, but sums for the rank's Gaussians must last until the
        // step.
        const bool lasts = renders && (k == mine ? mine + num_ranks >= views.size() : !projects_more);
        fn(projected_[k].splats, lasts ? room(views[k].id, own) : 0);
    }
}

void Shard::choose_places(const std::vector<ShownView>& views, std::size_t first, bool foreseen) {
    ranks_.settle();  // their contents may still be in transfer
    const std::size_t num_ranks = received_.size(), mine = first + rank_after(0);
    places_ = {};
    if (foreseen && mine < views.size()) {
        std::size_t splats = 0, placed = 0;
        for (std::size_t r = 0; r < num_ranks; ++r) splats += room(views[mine].id, r);
        for_places(views, first, [&](const auto&, std::size_t room) { placed += with_alignment(room); });
        places_ =
            engine_.room_for_splats(views[mine].camera, splats, placed, first == 0, first + num_ranks >= views.size());
    }
    for_places(views, first, one_after_another<WireSplat>(places_.splats));
}

void Shard::gather_splats(const std::vector<ShownView>& views, std::size_t first) {
    const std::size_t num_ranks = received_.size();
    const auto begin_projection = [&](std::size_t view) {
        if (view < views.size()) engine_.begin_projection(views[view].camera, views[view].mode, views[view].for_step);
    };
    const bool foreseen = makes_rooms_ && views[first].for_step;
    const auto end_projection = [&](std::size_t view) {
        const auto known = foreseen ? std::optional(room(views[view].id, rank_after(0))) : std::nullopt;
        engine_.end_projection(projected_[view], known, views[view].report);
    };
    const std::size_t mine = first + rank_after(0);
    const bool renders = mine < views.size();
    choose_places(views, first, foreseen);
    // Views of other ranks come first, so that their splats are in transfer while the next view is projected.
    begin_projection(first + rank_after(1));
    for (std::size_t offset = 1; offset < num_ranks; ++offset) {
        const std::size_t to = rank_after(offset), from = rank_after(num_ranks - offset), view = first + to;
        const bool sends = view < views.size();
        if (sends) end_projection(view);
        if (device_) device_->mark();
        begin_projection(first + rank_after(offset + 1));
        const std::vector<std::uint64_t> sent = {sends ? projected_[view].splats.size() : 0};
        std::vector<std::uint64_t> received = {renders && foreseen ? room(views[mine].id, from) : 0};
        std::vector<ConstBytes> out(num_ranks);
        std::vector<Bytes> in(num_ranks);
        if (!foreseen) {
            if (sends) out[to] = bytes_of(sent);
            if (renders) in[from] = room_of(received);
            ranks_.exchange(out, in);
        }
        received_[from].resize(received[0]);
        if (sends) out[to] = std::as_const(projected_[view]).splats.bytes();
        in[from] = received_[from].bytes();
        ranks_.begin(out, in, device_);
        splats_sent_ += double(sent[0]);
    }
    splats_.clear();
    if (!renders) return ranks_.finish(device_);
    end_projection(mine);
    for (const auto& part : received_) splats_.push_back(&part);
    splats_[rank_after(0)] = &projected_[mine].splats;
    ranks_.finish(device_);
}

template <class Sum>
void Shard::place_sums(const std::vector<ShownView>& views, std::size_t first, SumsOfViews<Sum>& sums) {
    const auto array_for = [&](const DeviceArray<WireSplat>& splats) {
        return sums.device ? DeviceArray<Sum>::in_memory_of(splats) : DeviceArray<Sum>();
    };
    while (sums.computed.size() < received_.size()) sums.computed.push_back(array_for(received_[sums.computed.size()]));
    while (sums.of_view.size() < projected_.size())
        sums.of_view.push_back(array_for(projected_[sums.of_view.size()].splats));
    sums.parts.clear();
    for (DeviceArray<Sum>& part : sums.computed) sums.parts.push_back(&part);
    if (const std::size_t mine = first + rank_after(0); mine < views.size())
        sums.parts[rank_after(0)] = &sums.of_view[mine];
    if constexpr (std::is_same_v<Sum, SplatSums<float>>)
        if (places_.sums) for_places(views, first, one_after_another<Sum>(places_.sums));
}

template <class Sum>
void Shard::scatter_sums(std::size_t first, const std::vector<ShownView>& views, SumsOfViews<Sum>& sums) {
    const std::size_t num_ranks = received_.size(), num_views = views.size();
    std::vector<ConstBytes> out(num_ranks);
    std::vector<Bytes> in(num_ranks);
    for (std::size_t offset = 1; offset < num_ranks; ++offset) {
        const std::size_t r = rank_after(offset);
        if (first + rank_after(0) < num_views) out[r] = std::as_const(sums.computed[r]).bytes();
        if (first + r >= num_views) continue;
        sums.of_view[first + r].resize(projected_[first + r].splats.size());
        in[r] = sums.of_view[first + r].bytes();
    }
    if (views[first].report && first + num_ranks >= num_views)
        for (std::size_t r = 0; r < num_ranks; ++r) {
            out.push_back(std::as_const(reports_).bytes());
            in.push_back(reports_of_all_ranks_.bytes(r * num_views, (r + 1) * num_views));
        }
    if (sums.device) sums.device->mark();
    ranks_.begin(out, in, sums.device);
}

void Shard::order_by_rows(std::size_t first_view, std::size_t num_views) {
    const std::size_t num_ranks = received_.size();
    if (num_ranks == 1) return;
    RowParts rows;
    std::vector<ConstBytes> out(num_ranks);
    std::vector<Bytes> in(num_ranks);
    for (std::size_t r = 0; r < num_ranks; ++r) {
        rows.emplace_back(device_);
        if (first_view + r < num_views) out[r] = std::as_const(projected_[first_view + r].rows).bytes();
        if (splats_.empty()) continue;
        rows[r].resize(splats_[r]->size());
        in[r] = rows[r].bytes();
    }
    ranks_.exchange(out, in, device_);
    if (splats_.empty()) return;
    engine_.order_by_rows(splats_, rows, rows_, ordered_);
    splats_ = {&ordered_};
}

void Shard::upload(const Gaussians* model) {
    const int num_ranks = ranks_.size();
    std::optional<Gaussians> part;
    // The parts are sent one by one, so that at most two are in memory besides the model.
    for (int r = 1; model && r < num_ranks; ++r) {
        MessageWriter message;
        put(message, dealt_part(*model, num_ranks, r));
        send_to(ranks_, r, message);
    }
    if (!model) {
        MessageReader message = receive_from_rank_0(ranks_);
        get(message, part.emplace());
    } else if (num_ranks > 1) {
        part = dealt_part(*model, num_ranks, 0);
    }
    const Gaussians& own = part ? *part : *model;
    engine_.upload(own);
    isp_size_ = own.ppisp.size();
    activation_ = own.appearance.activation;
    count_rows();
}

void Shard::upload_ppisp(const PpispState& state) {
    engine_.upload_ppisp(state);
    isp_size_ = state.size();
}

void Shard::count_rows() {
    rows_ = all_gather(ranks_, engine_.counts());
    num_gaussians_ = 0;
    for (const RowCounts& r : rows_) num_gaussians_ += r.count;
}

void Shard::download(bool with_moments, Gaussians* whole) {
    std::vector<Gaussians> parts(received_.size());
    parts[0] = engine_.download(with_moments ? Download::kAll : Download::kParameters);
    if (parts.size() == 1) {
        *whole = std::move(parts[0]);
        return;
    }
    MessageWriter message;
    if (!whole) put(message, parts[0]);
    const auto sizes = all_gather(ranks_, std::uint64_t(message.bytes().size()));
    std::vector<std::vector<std::byte>> received(sizes.size());
    std::vector<ConstBytes> out(sizes.size());
    std::vector<Bytes> in(sizes.size());
    out[0] = message.bytes();
    if (whole)
        for (std::size_t r = 0; r < sizes.size(); ++r) received[r].resize(sizes[r]), in[r] = received[r];
    ranks_.exchange(out, in);
    if (!whole) return;
    for (std::size_t r = 1; r < parts.size(); ++r) {
        MessageReader reader(std::move(received[r]));
        get(reader, parts[r]);
    }
    *whole = joined(parts);
}

void Shard::render(const std::vector<RenderRequest>& views, std::vector<RenderedImage>* out) {
    std::vector<ShownView> show;
    for (const RenderRequest& view : views) show.push_back({view.camera, view.mode});
    SumsOfViews<NoSum> none;
    std::vector<RenderedImage> own;
    std::vector<RenderedImage>& images = out ? *out : own;
    images.resize(views.size());
    render_views(show, none, [&](std::size_t k) { engine_.render(views[k], &splats_, images[k]); });
    const std::size_t num_ranks = std::size_t(ranks_.size());
    for (std::size_t first = 0; num_ranks > 1 && first < views.size(); first += num_ranks) {
        for (std::vector<float> RenderedImage::*plane : {&RenderedImage::rgb, &RenderedImage::alpha}) {
            std::vector<ConstBytes> send(num_ranks);
            std::vector<Bytes> receive(num_ranks);
            const std::size_t end = std::min(first + num_ranks, views.size());
            for (std::size_t k = first; ranks_.rank() == 0 && k < end; ++k) {
                if (k == first) continue;  // rank 0 already has its pixels
                const CameraParams<float>& camera = views[k].camera;
                images[k].width = camera.width, images[k].height = camera.height;
                const std::size_t channels = plane == &RenderedImage::rgb ? 3 : 1;
                (images[k].*plane).resize(channels * std::size_t(camera.width) * std::size_t(camera.height));
                receive[k - first] = room_of(images[k].*plane);
            }
            if (const std::size_t mine = first + std::size_t(ranks_.rank()); ranks_.rank() > 0 && mine < end)
                send[0] = bytes_of(images[mine].*plane);
            ranks_.exchange(send, receive);
        }
    }
}

void Shard::step(std::vector<StepRequest> views) {
    for (StepRequest& view : views) view.seed = rank_seed(view.seed, ranks_.rank());
    const std::size_t most_unread = makes_rooms_ && !corrects(views) ? 1 : 0;
    while (unread_.size() > most_unread) read_decision();  // the host takes the step of PPISP
    for (std::size_t k = rank_after(0); most_unread > 0 && k < views.size(); k += received_.size())
        keep_pixels(views[k]);
    begin_step(std::move(views));
    while (unread_.size() > most_unread) read_decision();
}

void Shard::begin_step(std::vector<StepRequest> step_views) {
    complete_step();
    std::vector<StepRequest>& views = unread_.emplace_back(std::move(step_views));
    isp_gradient_.assign(isp_size_, 0.0f);
    reports_.resize(views.size());
    reports_of_all_ranks_.resize(received_.size() * views.size());
    render_views(shown(views, reports_.data()), sums_, [&](std::size_t k) {
        bring_target(views[k]);
        engine_.loss_of_splats(views[k], splats_, sums_.parts, isp_gradient_, reports_.data() + k);
    });
    ranks_.finish(device_);
    engine_.update_rows(reports_of_all_ranks_, views, projected_, sums_.of_view, num_gaussians_, shared_);
    begin_shared();
    is_incomplete_ = true;
    // Over a link the transfer reaches the device while the next command is on its way.
    if (shared_.size() == 0 || !ranks_.link()) complete_step();
}

void Shard::complete_step() {
    if (!std::exchange(is_incomplete_, false)) return;
    if (shared_.size() > 0) ranks_.finish(device_);
    engine_.update_shared_weights(unread_.back(), shared_of_all_ranks_);
}

void Shard::read_decision() {
    std::vector<ImageId> ids;
    for (const StepRequest& view : unread_.front()) ids.push_back(view.target.id);
    const std::vector<ViewReport> reports = on_received([&] { return engine_.read_reports(ids, ranks_.rank()); });
    // A device continues with arbitrary data in its arrays if another rank is lost.
    if (ranks_.stop_token().stop_requested()) all_gather(ranks_, 0);  // throws
    const std::vector<StepRequest>& views = unread_.front();
    const std::size_t num_ranks = received_.size(), num_views = views.size();
    note_reports(views, reports);
    const StepDecision decision = decide_step(reports);
    if (decision == StepDecision::kRepeat) {
        complete_step();
        std::int64_t taken_back = 0;
        for (const auto& step : unread_) taken_back += std::int64_t(step.size());
        engine_.take_back(taken_back);
        for (auto& step : std::exchange(unread_, {})) {
            while (!unread_.empty()) read_decision();
            begin_step(std::move(step));
        }
        return;
    }
    const bool taken = decision == StepDecision::kTake;
    const double mean = 1 / double(num_views);
    stats_.loss = stats_.l1 = stats_.ssim = 0, stats_.num_instances = 0;
    for (std::size_t k = 0; k < num_views; ++k) {
        const ViewLoss& one = reports[k % num_ranks * num_views + k].loss;
        stats_.loss += mean * one.loss, stats_.l1 += mean * one.l1, stats_.ssim += mean * one.ssim;
        stats_.num_instances += one.num_instances;
    }
    ++stats_.steps;
    stats_.consecutive_skips = taken ? 0 : stats_.consecutive_skips + 1;
    if (unread_.size() == 1) complete_step();  // it is the last step, which leaves the list
    if (corrects(views)) {
        if (taken) {
            for (float& gradient : isp_gradient_) gradient *= float(mean);
            sum_over_ranks(ranks_, isp_gradient_);
        }
        update_ppisp(views, taken);
    }
    unread_.pop_front();
}

void Shard::note_reports(const std::vector<StepRequest>& views, const std::vector<ViewReport>& reports) {
    const std::size_t num_ranks = received_.size();
    std::vector<std::uint64_t> shares(views.size());
    for (std::size_t k = 0; k < views.size() && makes_rooms_; ++k) {
        std::uint64_t& share = shares[k];
        for (std::size_t r = 0; r < num_ranks; ++r) {
            const auto num = std::uint64_t(reports[r * views.size() + k].num_splats);
            share = std::max(share, SplatRooms::share(num, rows_[r].count));
        }
        for (std::size_t j = 0; j < k; ++j)  // a view may occur twice
            if (views[j].target.id == views[k].target.id) share = std::max(share, shares[j]);
        rooms_.note(views[k].target.id, share);
    }
}

void Shard::finish_steps() {
    complete_step();
    while (!unread_.empty()) {
        read_decision();
        complete_step();
    }
}

bool Shard::corrects(const std::vector<StepRequest>& views) const {
    return isp_size_ > 0 &&
           std::any_of(views.begin(), views.end(), [](const StepRequest& r) { return r.rates.isp > 0; });
}

void Shard::begin_shared() {
    const std::size_t num_ranks = received_.size(), row = shared_.size();
    if (row == 0) return;  // the same on all ranks
    shared_of_all_ranks_.resize(num_ranks * row);
    std::vector<ConstBytes> out(num_ranks, std::as_const(shared_).bytes());
    std::vector<Bytes> in;
    for (std::size_t r = 0; r < num_ranks; ++r) in.push_back(shared_of_all_ranks_.bytes(r * row, (r + 1) * row));
    if (device_) device_->mark();
    ranks_.begin(out, in, device_);
}

void Shard::update_ppisp(const std::vector<StepRequest>& views, bool taken) {
    PpispState state = engine_.download(Download::kPpisp).ppisp;  // it is small: the host takes its step
    const auto learns = [&](const StepRequest& r) { return is_corrected(state, r.isp) && r.rates.isp > 0; };
    if (std::none_of(views.begin(), views.end(), learns)) return;
    state.step += std::int64_t(views.size());
    if (taken && !step_ppisp(state, isp_gradient_, views[0].rates.isp, int(views.size()))) ++corrections_left_out_;
    engine_.upload_ppisp(state);
}

std::int64_t Shard::take_nonfinite() {
    engine_.synchronize();
    const StepStats own = engine_.take_stats();
    std::int64_t sum = std::exchange(corrections_left_out_, 0) + own.num_nonfinite_common;
    for (const std::int64_t of_rows : all_gather(ranks_, own.num_nonfinite_gradients - own.num_nonfinite_common))
        sum += of_rows;
    return sum;
}

void Shard::count_step(const CostsSoFar& begin) {
    ++costs_.steps;
    costs_.seconds += seconds_now() - begin.seconds;
    costs_.cpu_seconds += cpu_seconds() - begin.cpu_seconds;
    costs_.traffic += ranks_.traffic() - begin.traffic;
    costs_.splats_sent += splats_sent_ - begin.splats_sent;
}

void Shard::distill(const StepRequest& request) {
    SumsOfViews<NoSum> none;
    render_views({{request.camera}}, none, [&](std::size_t) { engine_.distill(request, &splats_); });
}

double Shard::half_squared_error(const StepRequest& request) {
    SumsOfViews<NoSum> none;
    double error = 0;
    render_views({{request.camera}}, none, [&](std::size_t) { error = engine_.half_squared_error(request, splats_); });
    return error;
}

std::vector<float> Shard::scores(const std::vector<RenderRequest>& views) {
    if (ranks_.size() == 1)
        if (auto of_engine = engine_.scores(views)) return std::move(*of_engine);
    std::vector<double> totals(std::size_t(engine_.counts().count), 0.0);
    const std::size_t batch = std::size_t(ranks_.size());
    SumsOfViews<double> sums;
    std::vector<std::uint32_t> copied_rows;
    for (std::size_t first = 0; first < views.size(); first += batch) {
        const std::size_t size = std::min(batch, views.size() - first);
        std::vector<ShownView> some;
        for (std::size_t k = 0; k < size; ++k) some.push_back({views[first + k].camera});
        render_views(some, sums,
                     [&](std::size_t k) { engine_.scores_of_splats(views[first + k], splats_, sums.parts); });
        for (std::size_t k = 0; k < size; ++k) {
            const auto rows = projected_[k].rows.on_host(copied_rows);
            for (std::size_t i = 0; i < rows.size(); ++i) totals[rows[i]] += sums.of_view[k].values()[i];
        }
    }
    return gather_rows_of_all({totals.begin(), totals.end()}, 1);
}

std::vector<StepRequest> Shard::next_steps(std::size_t first, std::size_t num_views, const StepSource* step_on) {
    std::vector<StepRequest> views;
    if (!step_on) {
        MessageReader message = receive_from_rank_0(ranks_);
        get(message, views);
        return views;
    }
    views.resize(std::min(num_views - first, std::size_t(ranks_.size())));
    // Rank 0 renders the first view, whose pixels become invalid at the next call of step_on.
    for (std::size_t k = views.size(); k-- > 0;) {
        views[k] = (*step_on)(first + k);
        if (k > 0) views[k].target.u8 = nullptr, views[k].target.f32 = nullptr;
    }
    if (ranks_.size() > 1) {
        MessageWriter message;
        put(message, views);
        send_to_others(ranks_, message);
    }
    return views;
}

ResidualScores Shard::residual_scores(std::uint64_t num_views, const StepSource* step_on) {
    if (ranks_.size() == 1)
        if (auto of_engine = engine_.residual_scores(num_views, *step_on)) return std::move(*of_engine);
    std::vector<ResidualSums> totals(std::size_t(engine_.counts().num_residuals), ResidualSums{});
    SumsOfViews<ResidualSplatSums> sums;
    const std::vector<float> bases = engine_.download(Download::kBases)[Group::kBase].param;
    const std::vector<Vec3<float>> colors = shown_bases(bases, activation_);
    for (std::size_t first = 0; first < num_views; first += std::size_t(ranks_.size())) {
        std::vector<StepRequest> some = next_steps(first, num_views, step_on);
        render_views(shown(some, nullptr), sums, [&](std::size_t k) {
            bring_target(some[k]);
            engine_.residual_sums_of_splats(some[k], splats_, sums.parts);
        });
        for (std::size_t k = 0; k < some.size(); ++k)
            add_view_to(totals, projected_[k], sums.of_view[k].values(), colors);
    }
    const ResidualScores own = residual_scores_of(totals, activation_, bases);
    return {gather_rows_of_all(own.worth, 1), gather_rows_of_all(own.mean_base, 3)};
}

DensifyStats Shard::densify(DensifyRequest request, const std::vector<std::int64_t>& shares) {
    const std::int64_t share = shares[std::size_t(ranks_.rank())];
    request.seed = rank_seed(request.seed, ranks_.rank());
    if (auto* mcmc = std::get_if<McmcParams>(&request.rule)) {
        mcmc->room = (mcmc->cap + ranks_.size() - 1) / ranks_.size();
        mcmc->cap = share;  // all of it at once: the growth of all ranks is already decided
        mcmc->growth = double(share) / double(std::max<std::int64_t>(1, engine_.counts().count)) + 1;
    } else if (auto* adc = std::get_if<AdcParams>(&request.rule)) {
        if (adc->cap > 0) adc->cap = std::max<std::int64_t>(1, share);
        adc->may_remove_all = true;
    }
    DensifyStats all;
    for (const DensifyStats& one : all_gather(ranks_, engine_.densify(request))) {
        all.relocated += one.relocated, all.added += one.added, all.cloned += one.cloned;
        all.split += one.split, all.pruned += one.pruned, all.count += one.count;
    }
    count_rows();
    return all;
}

PruneStats Shard::prune(const PruneRequest& request) {
    PruneStats all;
    for (const PruneStats& one : all_gather(ranks_, engine_.prune(request))) {
        all.removed += one.removed;
        for (int g = 0; g < kNumGroups; ++g) all.by_group[g] += one.by_group[g];
    }
    count_rows();
    return all;
}

void Shard::keep_rows(const std::vector<std::uint8_t>* marks) {
    const std::vector<std::uint8_t> own = scatter_rows(marks);
    AllBut kept;
    for (std::size_t i = 0; i < own.size(); ++i)
        if (own[i]) kept.rows.push_back(std::uint32_t(i));
    engine_.prune(kept);
    count_rows();
}

std::vector<RankReport> Shard::take_reports() {
    return all_gather(ranks_,
                      RankReport{take_costs(), engine_.counts().count, engine_.memory().bytes, resident_bytes()});
}

LinkSpeed Shard::measure_connection() { return measure_link(ranks_, device_); }

std::vector<float> Shard::gather_rows_of_all(const std::vector<float>& values, int width) {
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

std::vector<std::uint8_t> Shard::scatter_rows(const std::vector<std::uint8_t>* values) {
    std::vector<std::vector<std::uint8_t>> all(rows_.size());
    std::vector<ConstBytes> out(rows_.size());
    std::vector<Bytes> in(rows_.size());
    if (values) {
        for (std::size_t r = 0; r < all.size(); ++r) all[r].resize(std::size_t(rows_[r].count));
        auto from = values->begin();
        for (const DealtRow& place : row_order(rows_)) all[std::size_t(place.rank)][place.row] = *from++;
        for (std::size_t r = 0; r < all.size(); ++r) out[r] = bytes_of(all[r]);
    }
    std::vector<std::uint8_t> own(std::size_t(rows_[std::size_t(ranks_.rank())].count));
    in[0] = room_of(own);
    ranks_.exchange(out, in);
    return own;
}

}  // namespace gs
