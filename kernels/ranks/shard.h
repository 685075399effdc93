// SPDX-License-Identifier: Apache-2.0
// What a backend does for a training over several ranks, each of which holds a part of the Gaussians
// (docs/math/ranks.md).
#pragma once

#include <memory>
#include <vector>

#include "kernels/blend/residual_score.h"
#include "kernels/core/parallel.h"
#include "kernels/ranks/dealt_rows.h"
#include "kernels/ranks/rank_array.h"
#include "kernels/requests.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The splats of some Gaussians in one view, in the order of their rows.
struct ProjectedView {
    /// Makes an empty one in the memory of `device`, or of the host where that is null.
    explicit ProjectedView(RankDevice* device = nullptr) : splats(device), rows(device), places(device) {}

    RankArray<WireSplat> splats;
    RankArray<std::uint32_t> rows;    ///< of the splats, but not of a step's on a device
    RankArray<std::uint32_t> places;  ///< of a step's on a device: (Gaussians) the splat of each, kNowhere if none
    /// How many the view has, which may be more than there was room for. The host sees it once the shard has returned
    /// from take_losses().
    std::shared_ptr<std::uint64_t> num_found;
    std::vector<std::size_t> part_ends;  ///< (parts of kPartSize rows) number of splats up to the end of each
};

/// The splats of a view in parts, one from each rank in the order of the ranks, and what is summed up for each of them.
using SplatParts = std::vector<const RankArray<WireSplat>*>;
template <class Sum> using SumParts = std::vector<RankArray<Sum>*>;
using RowParts = std::vector<RankArray<std::uint32_t>>;

inline std::size_t num_splats(const SplatParts& parts) {
    std::size_t sum = 0;
    for (const auto* part : parts) sum += part->size();
    return sum;
}
/// Calls write(k, sum) for the k-th of all splats, where sums are on the host.
template <class Sum, class Write> void write_sums(const SplatParts& splats, const SumParts<Sum>& sums, Write&& write) {
    std::int64_t first = 0;
    for (std::size_t part = 0; part < splats.size(); ++part) {
        const auto size = std::int64_t(splats[part]->size());
        Sum* const out = sums[part]->resize(std::size_t(size));
        parallel_for_rows(size, [&](std::int64_t k) { write(first + k, out[k]); });
        first += size;
    }
}

/// The loss of one view and its parts.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
    bool fits = true;  ///< whether there was room for the instances; if not, the rest means nothing
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

/// Returns the number of values of a rank's gradient of so many shared weights: arrays that pass between ranks begin at
/// multiples of 16 bytes.
constexpr std::size_t shared_row(std::size_t num_weights) { return (num_weights + 3) / 4 * 4; }

/// Gradients that were left out because they were not finite.
struct LeftOut {
    std::int64_t of_rows = 0;    ///< of the rank's Gaussians
    std::int64_t of_common = 0;  ///< of shared weights and PPISP: the same on all ranks
};

/// The backend of one rank: the Gaussians that it holds, and the views that it renders of splats from all ranks. A view
/// is rendered in the order in which its splats come where their depths are equal. Splats, their rows, the gradient
/// sums of a step and the gradients of shared weights lie in the memory of device(); other sums in the host's.
class Shard {
  public:
    /// Returns the device on which the rank computes, which lives as long as the backend; null where that is the host.
    virtual RankDevice* device() { return nullptr; }

    /// Begins to compute the splats of the rank's Gaussians that touch a tile of the view: for a step, or for a frame,
    /// which may read residuals in half precision. A device is at work on it until end_projection().
    virtual void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) = 0;
    /// Writes the splats of the projection that was begun, the only one.
    virtual void end_projection(ProjectedView& out) = 0;
    /// Does the same without waiting for a device: writes `room` splats. Those beyond it are left out, and what they
    /// leave free reaches no pixel.
    virtual void end_projection(ProjectedView& out, std::size_t room) = 0;
    /// Makes room for the next view that is rendered for a step, and returns where in it `placed` of its `splats` are
    /// to lie, and later their sums in the same place; null if they should lie in memory of their own. What lies there
    /// stays through projections and update_rows(), until the next view is rendered.
    virtual std::byte* room_for_splats(const CameraParams<float>&, std::size_t /*splats*/, std::size_t /*placed*/) {
        return nullptr;
    }
    /// Does what order_on_host() says, where the arrays lie.
    virtual void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RankRows>& of_ranks,
                               RankArray<WireSplat>& out) = 0;

    /// Renders a view as Backend::render does.
    virtual void render_splats(const SplatParts& splats, const RenderRequest& request, RenderedImage& out) = 0;
    /// Begins to compute the loss of a view and the gradient sums of each splat, which mean nothing if the loss is not
    /// finite. Adds the gradient of the view's PPISP to `isp_gradient` (PpispState::size()) where it learns. `sums` may
    /// lie in the memory of `splats`: they are resized after the last use of these.
    virtual void loss_of_splats(const SplatParts& splats, const StepRequest& request,
                                const SumParts<SplatSums<float>>& sums, std::vector<float>& isp_gradient) = 0;
    /// Waits for what was begun, and returns the losses since the last call in order. Where one did not fit, there is
    /// room for it afterwards.
    virtual std::vector<ViewLoss> take_losses() = 0;
    /// Trains a controller as Backend::distill does.
    virtual void distill_splats(const SplatParts& splats, const StepRequest& request) = 0;
    virtual double squared_error_of_splats(const SplatParts& splats, const StepRequest& request) = 0;
    /// Computes what a view adds to the score of each splat (Backend::scores).
    virtual void scores_of_splats(const SplatParts& splats, const RenderRequest& request,
                                  const SumParts<double>& scores) = 0;
    /// Computes what a view says of the residual of each splat (Backend::residual_scores).
    virtual void residuals_of_splats(const SplatParts& splats, const StepRequest& request,
                                     const SumParts<ResidualSplatSums>& sums) = 0;

    /// Returns the colours that the rank's Gaussians show without a residual.
    virtual std::vector<Vec3<float>> colors_without_residual() = 0;
    virtual ResidualScores residual_scores_of_rows(const std::vector<ResidualSums>& totals) = 0;

    /// Takes the step of the rank's Gaussians on the mean gradient of `views`, of which `projected` and `sums` hold the
    /// splats that were projected and what was computed of them. `num_gaussians` counts those of all ranks. Writes the
    /// gradient of the shared weights by the rank's Gaussians, shared_row() values. A device may still be at work when
    /// the function returns.
    virtual void update_rows(const std::vector<StepRequest>& views, const std::vector<ProjectedView>& projected,
                             const std::vector<RankArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                             RankArray<float>& shared_gradient) = 0;
    /// Ends the step: takes that of the shared weights and of PPISP, and counts it. `shared_gradients` (ranks,
    /// shared_row()) are those of all ranks, which are added up in their order; `isp_gradient` is added up already.
    virtual void update_common(const std::vector<StepRequest>& views, const RankArray<float>& shared_gradients,
                               std::vector<float>& isp_gradient) = 0;
    /// Counts a step that is not taken.
    virtual void count_step(const std::vector<StepRequest>& views) = 0;
    /// Returns what was left out since the last call.
    virtual LeftOut take_nonfinite() = 0;

    /// Removes the rows that `rows` (ascending) does not name.
    virtual void keep_rows(const std::vector<std::uint32_t>& rows) = 0;

  protected:
    ~Shard() = default;
};

}  // namespace gs
