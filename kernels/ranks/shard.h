// SPDX-License-Identifier: Apache-2.0
// What a backend does for a training over several ranks, each of which holds a part of the Gaussians
// (docs/math/ranks.md).
#pragma once

#include <vector>

#include "kernels/blend/residual_score.h"
#include "kernels/core/parallel.h"
#include "kernels/ranks/rank_array.h"
#include "kernels/requests.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The splats of some Gaussians in one view, and the rows of these, ascending.
struct ProjectedView {
    /// Makes an empty one in the memory of `device`, or of the host where that is null.
    explicit ProjectedView(RankDevice* device = nullptr) : splats(device), rows(device) {}

    RankArray<WireSplat> splats;
    RankArray<std::uint32_t> rows;
    std::vector<std::size_t> part_ends;  ///< (parts of kPartSize rows) number of splats up to the end of each
};

/// The loss of one view and its parts.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
};

/// The sums of one splat over the pixels of a view that say what its residual is worth.
struct ResidualSplatSums {
    float weight;          ///< of the view's mask
    Vec3<float> gradient;  ///< of half the squared error by the colour
};

/// Adds what a view says of the residuals of a rank's Gaussians to `totals` (rows with a residual). `bases` are the
/// colours of all rows without a residual.
inline void add_view_to(std::vector<ResidualSums>& totals, const ProjectedView& projected,
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

/// Returns the colours that Gaussians with these base colours (n, 3) show without a residual.
inline std::vector<Vec3<float>> shown_bases(const std::vector<float>& bases, ColorActivation activation) {
    std::vector<Vec3<float>> out;
    for (std::size_t i = 0; i < bases.size(); i += 3)
        out.push_back(activate(activation, Vec3<float>{bases[i], bases[i + 1], bases[i + 2]}));
    return out;
}

/// The backend of one rank: the Gaussians that it holds, and the views that it renders of splats from all ranks. A view
/// is rendered in the order in which its splats come where their depths are equal. Splats, their rows and the gradient
/// sums of a step lie in the memory of device(); other sums in the host's.
class Shard {
  public:
    /// Returns the device on which the rank computes, which lives as long as the backend; null where that is the host.
    virtual RankDevice* device() { return nullptr; }

    /// Computes the splats of the rank's Gaussians that touch a tile of the view: for a step, or for a frame, which may
    /// read residuals in half precision.
    virtual void project(const CameraParams<float>& camera, RenderMode mode, bool for_step, ProjectedView& out) = 0;

    /// Renders a view as Backend::render does.
    virtual void render_splats(const RankArray<WireSplat>& splats, const RenderRequest& request,
                               RenderedImage& out) = 0;
    /// Computes the loss of a view, and the gradient sums of each splat if the loss is finite. Adds the gradient of the
    /// view's PPISP to `isp_gradient` (PpispState::size()) where it learns. `sums` may lie in the memory of `splats`:
    /// it is resized after their last use.
    virtual ViewLoss loss_of_splats(const RankArray<WireSplat>& splats, const StepRequest& request,
                                    RankArray<SplatSums<float>>& sums, std::vector<float>& isp_gradient) = 0;
    /// Trains a controller as Backend::distill does.
    virtual void distill_splats(const RankArray<WireSplat>& splats, const StepRequest& request) = 0;
    virtual double squared_error_of_splats(const RankArray<WireSplat>& splats, const StepRequest& request) = 0;
    /// Computes what a view adds to the score of each splat (Backend::scores).
    virtual void scores_of_splats(const RankArray<WireSplat>& splats, const RenderRequest& request,
                                  RankArray<double>& scores) = 0;
    /// Computes what a view says of the residual of each splat (Backend::residual_scores).
    virtual void residuals_of_splats(const RankArray<WireSplat>& splats, const StepRequest& request,
                                     RankArray<ResidualSplatSums>& sums) = 0;

    /// Returns the colours that the rank's Gaussians show without a residual.
    virtual std::vector<Vec3<float>> colors_without_residual() = 0;
    virtual ResidualScores residual_scores_of_rows(const std::vector<ResidualSums>& totals) = 0;

    /// Takes the step of the rank's Gaussians on the mean gradient of `views`, of which `projected` and `sums` hold the
    /// splats that project() made and what other ranks computed of them. `num_gaussians` counts those of all ranks.
    /// Returns the gradient of the shared weights by the rank's Gaussians. A device may still be at work on the rest.
    virtual std::vector<float> update_rows(const std::vector<StepRequest>& views,
                                           const std::vector<ProjectedView>& projected,
                                           const std::vector<RankArray<SplatSums<float>>>& sums,
                                           std::int64_t num_gaussians) = 0;
    /// Ends the step: takes that of the shared weights and of PPISP, with gradients summed over ranks, and counts it.
    /// Returns the number of these that were skipped because a gradient was not finite.
    virtual std::int64_t update_common(const std::vector<StepRequest>& views, const std::vector<float>& shared_gradient,
                                       std::vector<float>& isp_gradient) = 0;
    /// Counts a step that is not taken.
    virtual void count_step(const std::vector<StepRequest>& views) = 0;
    /// Returns the number of the rank's gradients that were left out since the last call because they were not finite.
    virtual std::int64_t take_nonfinite() = 0;

    /// Removes the rows that `rows` (ascending) does not name.
    virtual void keep_rows(const std::vector<std::uint32_t>& rows) = 0;

  protected:
    ~Shard() = default;
};

}  // namespace gs
