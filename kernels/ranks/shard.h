// SPDX-License-Identifier: Apache-2.0
// One rank's part of a model, and of the operations of all ranks.
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

/// Predicts the share of a rank's Gaussians that a view shows. All ranks record the same shares and so predict the
/// same, in integers, which round alike on every machine. Rows are dealt so that all ranks show about equal shares.
class SplatRooms {
  public:
    /// Returns the share of `num` in `rows` Gaussians, rounded up, in units of 2^-20.
    static std::uint64_t share(std::uint64_t num, std::int64_t rows) {
        return rows > 0 ? (num * kOne + std::uint64_t(rows) - 1) / std::uint64_t(rows) : 0;
    }
    /// Returns an estimate that the number of splats of a rank with `rows` Gaussians rarely exceeds in a view, at most
    /// `rows`.
    std::size_t room(ImageId view, std::int64_t rows) const {
        const auto found = shares_.find(view);
        const std::uint64_t share = found == shares_.end() ? largest_ : found->second;
        return std::min<std::uint64_t>(rows, (share + share / kMargin) * std::uint64_t(rows) / kOne + kLeast);
    }
    /// Records the largest share that any rank showed. Later estimates for the same known view are based on it.
    void note(ImageId view, std::uint64_t share) {
        if (view.is_known()) shares_[view] = share;
        largest_ = std::max(largest_, share);
    }

  private:
    static constexpr std::uint64_t kOne = 1 << 20, kMargin = 8, kLeast = 16;
    std::uint64_t largest_ = kOne / 4;  ///< share assumed for views that were not seen yet
    std::unordered_map<ImageId, std::uint64_t, ImageIdHash> shares_;
};

/// Loads the pixels of a step's target. They stay valid as long as the request, by StepRequest::pixels or otherwise.
using TargetSource = std::function<void(StepRequest& request)>;

/// Costs of a rank's steps since they were last taken.
struct RankCosts {
    std::int64_t steps = 0;
    double seconds = 0;
    double cpu_seconds = 0;  ///< CPU time of all threads of the process
    Traffic traffic;         ///< traffic of these steps, including the commands of rank 0
    double splats_sent = 0;  ///< number including unused places, and splats of repeated steps
};

/// A view for which Gaussians are projected.
struct ShownView {
    CameraParams<float> camera;
    RenderMode mode = RenderMode::kFull;
    bool for_step = false;
    ImageId id = {};               ///< id of a training view
    ViewReport* report = nullptr;  ///< report on a step's view
};

/// Sums over pixels for the splats of several views: in host memory, or on a device in the place of the splats.
template <class Sum> struct SumsOfViews {
    DeviceStream* device = nullptr;          ///< null for the host
    std::vector<DeviceArray<Sum>> computed;  ///< sums by rank: for the splats received from that rank
    std::vector<DeviceArray<Sum>> of_view;   ///< sums by view: for the rank's own splats
    SumParts<Sum> parts;                     ///< sums for all splats of the view that this rank renders
};

/// Contents of a rank, and the costs of its steps since the last report.
struct RankReport {
    RankCosts costs;
    std::int64_t rows = 0;
    std::int64_t device_bytes = 0;    ///< DeviceModel::memory(); 0 on the CPU
    std::int64_t resident_bytes = 0;  ///< memory of the process, at the time of the report
};

/// One rank's part of each operation. All ranks call the same functions in the same order and with the same arguments,
/// except for pointers, which only rank 0 passes. Results are for rank 0, unless a function states otherwise; other
/// ranks get incomplete results.
class Shard {
  public:
    /// Calls `targets` for images that a request does not contain. All arguments must outlive the object.
    Shard(Communicator& ranks, Engine& engine, TargetSource targets);

    /// Replaces the model, whose rows are dealt to the ranks.
    void upload(const Gaussians* model);
    /// Replaces PPISP, of which every rank holds a full copy.
    void upload_ppisp(const PpispState& state);
    /// Writes the model joined from the parts of all ranks.
    void download(bool with_moments, Gaussians* out);
    void set_active_degree(int degree) { engine_.set_active_degree(degree); }
    void update_smoothing(const std::vector<CameraParams<float>>& cameras) { engine_.update_smoothing(cameras); }
    /// Renders views: view k on rank k modulo the number of ranks. The images are bitwise equal to those of a single
    /// rank.
    void render(const std::vector<RenderRequest>& views, std::vector<RenderedImage>* out);
    /// Takes a step; view k is rendered by rank k modulo the number of ranks. If devices can predict the room for
    /// splats, and PPISP is not trained in the step, they decide by themselves whether to take the step. That decision
    /// is read in the next step, or by finish_steps().
    void step(std::vector<StepRequest> views);
    /// Completes all steps and reads their decisions. Must be called before the rank's engine does anything but a step.
    void finish_steps();
    /// Returns the number of gradients left out since the last call: of the Gaussians of all ranks, and of the
    /// parameters common to all ranks.
    std::int64_t take_nonfinite();
    /// Returns the gradients of the cameras of the steps since the last call, on every rank.
    std::vector<ViewCameraGradient> take_camera_gradients() { return engine_.take_camera_gradients(); }
    /// Trains a controller on rank 0.
    void distill(const StepRequest& request);
    /// Returns half the squared error of a view; 0 on other ranks.
    double half_squared_error(const StepRequest& request);
    /// Returns the scores of all rows, in the order of the whole model.
    std::vector<float> scores(const std::vector<RenderRequest>& views);
    /// Returns the values of the residuals for `num_views` views, for all rows in the order of the whole model.
    ResidualScores residual_scores(std::uint64_t num_views, const StepSource* step_on);
    /// Applies the rule of `request`, after which rank r may have `shares[r]` Gaussians. Returns the statistics of all
    /// ranks.
    DensifyStats densify(DensifyRequest request, const std::vector<std::int64_t>& shares);
    /// Removes Gaussians by a criterion that needs no other rows. Returns the statistics of all ranks.
    PruneStats prune_nonfinite() { return prune(NonFiniteRows{}); }
    PruneStats prune_invisible() { return prune(InvisibleRows{}); }
    /// Keeps the rows with a mark (0 or 1, one per row of the whole model).
    void keep_rows(const std::vector<std::uint8_t>* marks);
    void morton_sort() { engine_.densify({.rule = MortonOrder{}}); }
    /// Returns the reports of all ranks, by rank.
    std::vector<RankReport> take_reports();
    /// Measures the connection between the ranks (measure_link).
    LinkSpeed measure_connection();

    /// Gets the number of Gaussians of every rank, after it changed.
    void count_rows();
    /// Completes the part of the last step that waits for other ranks, if there is one.
    void complete_step();
    /// Returns whether finish_steps() has work to do. The result is the same on all ranks.
    bool has_unfinished_steps() const { return !unread_.empty(); }
    /// Returns the statistics of the steps whose decisions were read, without the counts of gradients left out.
    StepStats& stats() { return stats_; }
    /// Returns the row counts of every rank.
    const std::vector<RowCounts>& rows() const { return rows_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }

    /// The costs of a rank up to the beginning of a step.
    struct CostsSoFar {
        double seconds, cpu_seconds;
        Traffic traffic;
        double splats_sent;
    };
    CostsSoFar costs_so_far() const { return {seconds_now(), cpu_seconds(), ranks_.traffic(), splats_sent_}; }
    /// Adds the cost of a step since `begin`.
    void count_step(const CostsSoFar& begin);
    RankCosts take_costs() { return std::exchange(costs_, {}); }

  private:
    PruneStats prune(const PruneRequest& request);
    /// Returns the values of all rows in the order of the whole model on rank 0, and nothing on the others. Each rank
    /// passes `width` values per row.
    std::vector<float> gather_rows_of_all(const std::vector<float>& values, int width);
    /// Returns the values of the rank's rows. Rank 0 passes one value per row of the whole model, others nothing.
    std::vector<std::uint8_t> scatter_rows(const std::vector<std::uint8_t>* values);
    /// Returns the next steps of residual_scores(), at most one for each rank, with pixels on rank 0 only.
    std::vector<StepRequest> next_steps(std::size_t first, std::size_t num_views, const StepSource* step_on);
    /// Takes the step of PPISP on the gradient of all ranks, or only counts it if the step was skipped.
    void update_ppisp(const std::vector<StepRequest>& views, bool taken);
    /// Projects `views` and calls view(k) on the rank that renders view k, once its splats are in splats_. If there are
    /// sums, view(k) fills sums.parts for splats_; after Communicator::finish() sums.of_view[k] holds the sums for the
    /// splats of projected_[k], whose memory it may have taken over. Splats of views without sums are in the order of
    /// the whole model's rows, others by rank.
    template <class Sum, class Fn>
    void render_views(const std::vector<ShownView>& views, SumsOfViews<Sum>& sums, Fn&& view);
    /// Chooses the places of the splats and the sums of the views from `first` on, one for each rank. In a step they
    /// lie in scratch memory as far as nothing else needs it meanwhile; otherwise in separate memory.
    void choose_places(const std::vector<ShownView>& views, std::size_t first, bool foreseen);
    /// Calls fn(array, room) for the splats of the same views: with their number if scratch memory can hold them, or
    /// else with 0.
    template <class Fn> void for_places(const std::vector<ShownView>& views, std::size_t first, Fn&& fn);
    /// Projects the views from `first` on, one for each rank or until the end of `views`, and collects the splats of
    /// the view that this rank renders in splats_.
    void gather_splats(const std::vector<ShownView>& views, std::size_t first);
    /// Sets sums.parts for the view that this rank renders, one of the views from `first` on, and assigns sums their
    /// places.
    template <class Sum>
    void place_sums(const std::vector<ShownView>& views, std::size_t first, SumsOfViews<Sum>& sums);
    /// Begins to send the sums of the views from `first` on to the ranks that own the splats. With the last views of a
    /// step it also sends the reports to all ranks.
    template <class Sum>
    void scatter_sums(std::size_t first, const std::vector<ShownView>& views, SumsOfViews<Sum>& sums);
    /// Sorts splats_ by their rows in the whole model. All ranks call it, with the views that the ranks from 0 on
    /// render.
    void order_by_rows(std::size_t first_view, std::size_t num_views);
    /// Returns the rank that comes `offset` places after this one, cyclically.
    std::size_t rank_after(std::size_t offset) const;
    /// Begins to gather the gradients of the shared weights of all ranks in shared_of_all_ranks_; shared_ holds this
    /// rank's.
    void begin_shared();
    /// Returns whether a step trains PPISP.
    bool corrects(const std::vector<StepRequest>& views) const;
    /// Loads the pixels of a request that has none.
    void bring_target(StepRequest& request) const;
    /// Calls fn() on splats that came from other ranks. If one of these ranks is lost the splats are invalid; then it
    /// throws the error of the lost rank instead of any error of fn().
    template <class Fn> auto on_received(Fn&& fn);
    /// Begins a step: computes the losses of its views, the sums of all splats and isp_gradient_, decides and updates.
    void begin_step(std::vector<StepRequest> views);
    /// Reads the oldest unread decision. If it demands more room, takes that step and all later ones again, with enough
    /// room; the last of their decisions stays unread.
    void read_decision();
    /// Records the reports of all ranks on the views of a step, so that there is room for these views from then on.
    void note_reports(const std::vector<StepRequest>& views, const std::vector<ViewReport>& reports);
    /// Returns the room for a rank's splats of a view.
    std::size_t room(ImageId view, std::size_t rank) const { return rooms_.room(view, rows_[rank].count); }

    Communicator& ranks_;
    Engine& engine_;
    DeviceStream* const device_;  ///< stream of the engine's device, null if it computes on the host
    const TargetSource targets_;
    std::vector<RowCounts> rows_;
    std::int64_t num_gaussians_ = 0;
    std::size_t isp_size_ = 0;  ///< number of values of PPISP
    ColorActivation activation_ = ColorActivation::kRelu;
    std::int64_t corrections_left_out_ = 0;  ///< steps of PPISP left out, since take_nonfinite()
    const bool makes_rooms_;                 ///< whether to predict room for splats, without waiting for counts
    SplatRooms rooms_;
    std::vector<ProjectedView> projected_;          ///< the rank's splats, per view
    std::vector<DeviceArray<WireSplat>> received_;  ///< splats from the other ranks for the view to render, by rank
    SplatParts splats_;                             ///< splats of the view to render
    DeviceArray<WireSplat> ordered_;                ///< the same, by their rows in the whole model
    SumsOfViews<SplatSums<float>> sums_;            ///< sums of a step, in splat or scratch memory
    ScratchPlaces places_;                          ///< places for the views to render
    DeviceArray<ViewReport> reports_, reports_of_all_ranks_;  ///< reports on a step's views, (ranks, views)
    DeviceArray<float> shared_, shared_of_all_ranks_;  ///< gradients of the shared weights, (ranks, shared_row())
    bool is_incomplete_ = false;                       ///< whether the last step waits for complete_step()
    std::deque<std::vector<StepRequest>> unread_;      ///< views of the steps with unread decisions, in order
    StepStats stats_;
    std::vector<float> isp_gradient_;  ///< gradient of PPISP in the step
    double splats_sent_ = 0;           ///< number sent to other ranks, since the beginning
    RankCosts costs_;
};

}  // namespace gs
