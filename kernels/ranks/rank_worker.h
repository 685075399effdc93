// SPDX-License-Identifier: Apache-2.0
// A rank's part of what all ranks do together. All call the same functions with the same arguments, unless one says
// otherwise, and in the same order.
#pragma once

#include <functional>
#include <utility>

#include "kernels/backend.h"
#include "kernels/ranks/communicator.h"
#include "kernels/ranks/dealt_rows.h"
#include "kernels/ranks/shard.h"

namespace gs {

/// Returns the pixels of a step's target. They stay valid until the next call.
using TargetSource = std::function<TargetImage(const StepRequest& request)>;

/// What the steps of a rank have cost since the last look.
struct RankCosts {
    std::int64_t steps = 0;
    double seconds = 0;
    double waiting_seconds = 0;  ///< part of these spent in exchanges, where a rank also waits for slower ones
    double bytes = 0;            ///< of splats and of their gradients, sent to other ranks
};

class RankWorker {
  public:
    /// `backend` must have a shard. `targets` is asked for images that a request does not bring along. All must outlive
    /// the object.
    RankWorker(Communicator& ranks, Backend& backend, TargetSource targets);

    /// Replaces the rank's Gaussians by `part`, each rank's own.
    void upload(const Gaussians& part);
    /// Replaces PPISP, of which every rank has the whole.
    void upload_ppisp(const PpispState& state);
    /// Returns the parts of all ranks on rank 0, and nothing on the others.
    std::vector<Gaussians> download(bool with_moments);
    /// Renders a view on rank 0; `out` is left alone on the others.
    void render(const RenderRequest& request, RenderedImage& out);
    /// Takes a step; view k is rendered by rank k modulo their number. Returns the statistics of this step alone.
    StepStats step(std::vector<StepRequest> views);
    /// Trains a controller on rank 0.
    void distill(const StepRequest& request);
    /// Returns half the squared error of a view on rank 0, 0 on the others.
    double squared_error(const StepRequest& request);
    /// Returns the scores of the rank's Gaussians.
    std::vector<float> scores(const std::vector<RenderRequest>& views);
    /// Returns what the residuals of the rank's Gaussians are worth to `views`. target(k) brings the image of view k,
    /// which stays valid until the next call.
    ResidualScores residual_scores(const std::vector<StepRequest>& views,
                                   const std::function<TargetImage(std::size_t view)>& target);
    /// Applies the rule of `request` to the rank's Gaussians, of which each rank may then have `shares[rank]`.
    DensifyStats densify(DensifyRequest request, const std::vector<std::int64_t>& shares);

    /// Learns how many Gaussians every rank has, after they changed.
    void count_rows();
    /// Returns the Gaussians of every rank.
    const std::vector<RankRows>& rows() const { return rows_; }
    std::int64_t num_gaussians() const { return num_gaussians_; }
    /// Returns the values of all rows in the order of the whole model on rank 0, and nothing on the others. Each rank
    /// gives `width` per row.
    std::vector<float> gather_rows_of_all(const std::vector<float>& values, int width);
    /// Returns the values of the rank's rows. Rank 0 gives one per row of the whole model, others nothing.
    std::vector<std::uint8_t> scatter_rows(const std::vector<std::uint8_t>& values);

    RankCosts take_costs() { return std::exchange(costs_, {}); }
    Backend& backend() { return backend_; }

  private:
    /// Projects `cameras` and calls view(k) on the rank that renders view k, when its splats are in splats_. `sums` are
    /// per view, and view(k) fills sums_of_view for splats_. Afterwards `sums[k]` has those of the splats in
    /// projected_[k].
    template <class Sum, class Fn>
    void render_views(const std::vector<CameraParams<float>>& cameras, RenderMode mode,
                      std::vector<std::vector<Sum>>& sums, Fn&& view);
    template <class Out, class In> void exchange(const Out& out, const In& in);
    void bring_target(StepRequest& request) const;

    Communicator& ranks_;
    Backend& backend_;
    Shard& shard_;
    const TargetSource targets_;
    std::vector<RankRows> rows_;
    std::int64_t num_gaussians_ = 0;
    std::size_t isp_size_ = 0;                         ///< values of PPISP
    std::vector<ProjectedView> projected_;             ///< per view: the rank's splats
    std::vector<WireSplat> splats_;                    ///< of the view that is rendered: those of all ranks, by rank
    std::vector<std::vector<SplatSums<float>>> sums_;  ///< per view: of projected_
    RankCosts costs_;
};

}  // namespace gs
