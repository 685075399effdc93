// SPDX-License-Identifier: Apache-2.0
// A rank's part of a model, and of what all ranks do together.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <unordered_map>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/engine.h"
#include "kernels/ranks/communicator.h"
#include "kernels/ranks/dealt_rows.h"
#include "kernels/splat/projected_view.h"

namespace gs {

/// Foresees what share of a rank's Gaussians a view shows. All ranks note the same and so foresee the same: in whole
/// numbers, which round alike on every machine. Rows are dealt so that ranks show about equal shares.
class SplatRooms {
  public:
    /// Returns what share `num` of `rows` Gaussians are, rounded up, in units of 2^-20.
    static std::uint64_t share(std::uint64_t num, std::int64_t rows) {
        return rows > 0 ? (num * kOne + std::uint64_t(rows) - 1) / std::uint64_t(rows) : 0;
    }
    /// Returns a number that the splats of a rank with `rows` Gaussians hardly exceed in a view, at most `rows`.
    std::size_t room(ImageId view, std::int64_t rows) const {
        const auto found = shares_.find(view);
        const std::uint64_t share = found == shares_.end() ? largest_ : found->second;
        return std::min<std::uint64_t>(rows, (share + share / kMargin) * std::uint64_t(rows) / kOne + kLeast);
    }
    /// Takes the largest share that any rank showed. What a known view needed then it has
    /// room for from now on.
    void note(ImageId view, std::uint64_t share) {
        if (view.is_known()) shares_[view] = share;
        largest_ = std::max(largest_, share);
    }

  private:
    static constexpr std::uint64_t kOne = 1 << 20, kMargin = 8, kLeast = 16;
    std::uint64_t largest_ = kOne / 4;  ///< what is made room for in views that were not seen yet
    std::unordered_map<ImageId, std::uint64_t, ImageIdHash> shares_;
};

/// Brings the pixels of a step's target. They stay as long as the request, by StepRequest::pixels or otherwise.
using TargetSource = std::function<void(StepRequest& request)>;

/// What the steps of a rank have cost since the last look.
struct RankCosts {
    std::int64_t steps = 0;
    double seconds = 0;
    double cpu_seconds = 0;  ///< of all threads of the process
    Traffic traffic;         ///< of these steps, the commands of rank 0 included
    double splats_sent = 0;  ///< with what fills room, and those of repeated steps
};

/// A view as the Gaussians are projected for it.
struct ShownView {
    CameraParams<float> camera;
    RenderMode mode = RenderMode::kFull;
    bool for_step = false;
    ImageId id = {};               ///< of a training view
    ViewReport* report = nullptr;  ///< of a step's view
};

/// Sums over pixels of splats in several views: in the host's memory, or on a device in the place of the splats.
template <class Sum> struct SumsOfViews {
    DeviceStream* device = nullptr;          ///< null for the host
    std::vector<DeviceArray<Sum>> computed;  ///< by rank: of the splats that came from there
    std::vector<DeviceArray<Sum>> of_view;   ///< by view: of the rank's own splats
    SumParts<Sum> parts;                     ///< of the view that this rank renders: of all its splats
};

/// What a rank holds, and the costs of its steps since the last report.
struct RankReport {
    RankCosts costs;
    std::int64_t rows = 0;
    std::int64_t device_bytes = 0;    ///< DeviceModel::memory(); 0 on the CPU
    std::int64_t resident_bytes = 0;  ///< of the process, at the time of the report
};

/// All ranks call the same functions in the same order and with the same arguments, but for pointers, which only rank 0
/// passes. Results are for rank 0, unless a function says otherwise; the others get some of them.
class Shard {
  public:
    /// `targets` is asked for images that a request does not bring along. All must outlive the object.
    Shard(Communicator& ranks, Engine& engine, TargetSource targets);

    /// Replaces the model, which is dealt to the ranks.
    void upload(const Gaussians* model);
    /// Replaces PPISP, of which every rank has the whole.
    void upload_ppisp(const PpispState& state);
    /// Writes the model that the ranks hold.
    void download(bool with_moments, Gaussians* out);
    void set_active_degree(int degree) { engine_.set_active_degree(degree); }
    /// Renders views, view k on rank k modulo their number. The images are those that one rank would render, to the
    /// bit.
    void render(const std::vector<RenderRequest>& views, std::vector<RenderedImage>* out);
    /// Takes a step; view k is rendered by rank k modulo their number. Where devices know the room that splats need,
    /// and PPISP does not learn, they decide for themselves whether the step is taken, and its decision is read in the
    /// next step, or by finish_steps().
    void step(std::vector<StepRequest> views);
    /// Completes all steps and reads their decisions, before anything but a step is done with the rank's engine.
    void finish_steps();
    /// Returns the number of gradients that were left out since the last call: of all ranks' Gaussians, and of what is
    /// common to them.
    std::int64_t take_nonfinite();
    /// Trains a controller on rank 0.
    void distill(const StepRequest& request);
    /// Returns half the squared error of a view, 0 on other ranks.
    double half_squared_error(const StepRequest& request);
    /// Returns the scores of all rows, in the order of the whole model.
    std::vector<float> scores(const std::vector<RenderRequest>& views);
    /// Returns what residuals are worth to `num_views` views, for all rows in the order of the whole model.
    ResidualScores residual_scores(std::uint64_t num_views, const StepSource* step_on);
    /// Applies the rule of `request`; of each rank there may then be `shares[rank]` Gaussians. Returns the statistics
    /// of all ranks.
    DensifyStats densify(DensifyRequest request, const std::vector<std::int64_t>& shares);
    /// Removes Gaussians that can be told by themselves. Returns the statistics of all ranks.
    PruneStats prune_nonfinite() { return prune(NonFiniteRows{}); }
    PruneStats prune_invisible() { return prune(InvisibleRows{}); }
    /// Keeps the rows with a mark (0 or 1, one per row of the whole model).
    void keep_rows(const std::vector<std::uint8_t>* marks);
    void morton_sort() { engine_.densify({.rule = MortonOrder{}}); }
    /// Returns the reports of all ranks, by rank.
    std::vector<RankReport> take_reports();
    /// Measures the connection between the ranks (measure_link).
    LinkSpeed measure_connection();

    /// Learns how many Gaussians every rank has, after they changed.
    void count_rows();
    /// Lets the last step take what it waits for from other ranks, if anything.
    void complete_step();
    /// Returns whether finish_steps() has something to do: on all ranks the same.
    bool has_unfinished_steps() const { return !unread_.empty(); }
    /// Returns the statistics of the steps whose decisions were read, without gradients that were left out.
    StepStats& stats() { return stats_; }
    /// Returns the Gaussians of every rank.
    const std::vector<RowCounts>& rows() const { return rows_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }

    /// The costs of a rank up to the beginning of a step.
    struct CostsSoFar {
        double seconds, cpu_seconds;
        Traffic traffic;
        double splats_sent;
    };
    CostsSoFar costs_so_far() const { return {seconds_now(), cpu_seconds(), ranks_.traffic(), splats_sent_}; }
    /// Counts what a step has cost since `begin`.
    void count_step(const CostsSoFar& begin);
    RankCosts take_costs() { return std::exchange(costs_, {}); }

  private:
    PruneStats prune(const PruneRequest& request);
    /// Returns the values of all rows in the order of the whole model on rank 0, and nothing on the others. Each rank
    /// gives `width` per row.
    std::vector<float> gather_rows_of_all(const std::vector<float>& values, int width);
    /// Returns the values of the rank's rows. Rank 0 gives one per row of the whole model, others nothing.
    std::vector<std::uint8_t> scatter_rows(const std::vector<std::uint8_t>* values);
    /// Returns the next steps of residual_scores(), at most one for each rank, with pixels on rank 0 alone.
    std::vector<StepRequest> next_steps(std::size_t first, std::size_t num_views, const StepSource* step_on);
    /// Takes the step of PPISP on the gradient of all ranks, or only counts it if the step was skipped.
    void update_ppisp(const std::vector<StepRequest>& views, bool taken);
    /// Projects `views` and calls view(k) on the rank that renders view k, when its splats are in splats_. With `sums`,
    /// view(k) fills sums.parts for splats_, and after Communicator::finish() sums.of_view[k] has those of the splats
    /// of projected_[k], whose memory it may have. Views without sums have their splats in the order of the whole
    /// model's rows, the others by rank.
    template <class Sum, class Fn>
    void render_views(const std::vector<ShownView>& views, SumsOfViews<Sum>& sums, Fn&& view);
    /// Decides where the splats of the views from `first` on will lie, one for each rank, and where their sums: in a
    /// step in scratch memory as far as nothing else needs it meanwhile, or else in memory of their own.
    void choose_places(const std::vector<ShownView>& views, std::size_t first, bool foreseen);
    /// Calls fn(array, room) for the splats of the same views: for those that scratch memory can have with their
    /// number, or else with 0.
    template <class Fn> void for_places(const std::vector<ShownView>& views, std::size_t first, Fn&& fn);
    /// Projects the views from `first` on, one for each rank or until `views` end, and brings those of the view that
    /// this rank renders to splats_.
    void gather_splats(const std::vector<ShownView>& views, std::size_t first);
    /// Sets sums.parts for the view that this rank renders, of those from `first` on, and lets sums lie in their
    /// places.
    template <class Sum>
    void place_sums(const std::vector<ShownView>& views, std::size_t first, SumsOfViews<Sum>& sums);
    /// Begins to bring the sums of the views from `first` on to the ranks that have the splats, and with the last ones
    /// of a step its reports to all.
    template <class Sum>
    void scatter_sums(std::size_t first, const std::vector<ShownView>& views, SumsOfViews<Sum>& sums);
    /// Sorts splats_ by their rows in the whole model. All ranks call it, with the view that each of the ranks from 0
    /// on renders.
    void order_by_rows(std::size_t first_view, std::size_t num_views);
    /// Returns the rank that comes `offset` places after this one, in a circle.
    std::size_t rank_after(std::size_t offset) const;
    /// Begins to bring the gradients of the shared weights by all ranks to shared_of_all_ranks_; shared_ has the own.
    void begin_shared();
    /// Returns whether PPISP learns from a step.
    bool corrects(const std::vector<StepRequest>& views) const;
    /// Brings the pixels of a request that has none.
    void bring_target(StepRequest& request) const;
    /// Calls fn() on splats that came from other ranks. Where one of these is lost they are not what it sent; then it
    /// throws what says so instead of the error that comes of it.
    template <class Fn> auto on_received(Fn&& fn);
    /// Begins a step: computes the losses of its views, the sums of all splats and isp_gradient_, decides and updates.
    void begin_step(std::vector<StepRequest> views);
    /// Reads the oldest decision that was not read. Where it says so, that step and all after it are taken once more,
    /// with room; the last of these decisions is not read.
    void read_decision();
    /// Takes notice of what all ranks say of the views of a step: there is room for them then.
    void note_reports(const std::vector<StepRequest>& views, const std::vector<ViewReport>& reports);
    /// Returns the room that a rank's splats of a view have.
    std::size_t room(ImageId view, std::size_t rank) const { return rooms_.room(view, rows_[rank].count); }

    Communicator& ranks_;
    Engine& engine_;
    DeviceStream* const device_;  ///< of the engine, null if it computes on the host
    const TargetSource targets_;
    std::vector<RowCounts> rows_;
    std::int64_t num_gaussians_ = 0;
    std::size_t isp_size_ = 0;  ///< values of PPISP
    ColorActivation activation_ = ColorActivation::kRelu;
    std::int64_t corrections_left_out_ = 0;  ///< steps of PPISP, since take_nonfinite()
    const bool makes_rooms_;                 ///< for splats of steps, so that nobody waits for their number
    SplatRooms rooms_;
    std::vector<ProjectedView> projected_;          ///< per view: the rank's splats
    std::vector<DeviceArray<WireSplat>> received_;  ///< by rank: splats of the view that is rendered, from the others
    SplatParts splats_;                             ///< of the view that is rendered
    DeviceArray<WireSplat> ordered_;                ///< these, by their rows in the whole model
    SumsOfViews<SplatSums<float>> sums_;            ///< of a step, in the memory of the splats or in scratch memory
    ScratchPlaces places_;                          ///< of the views that are rendered
    DeviceArray<ViewReport> reports_, reports_of_all_ranks_;  ///< on the views of a step, (ranks, views)
    DeviceArray<float> shared_, shared_of_all_ranks_;  ///< gradients of the shared weights, (ranks, shared_row())
    bool is_incomplete_ = false;                       ///< the last step waits for complete_step()
    std::deque<std::vector<StepRequest>> unread_;      ///< views of the steps whose decisions were not read, in order
    StepStats stats_;
    std::vector<float> isp_gradient_;  ///< by PPISP, of the step
    double splats_sent_ = 0;           ///< to other ranks, since the beginning
    RankCosts costs_;
};

}  // namespace gs
