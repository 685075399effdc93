// SPDX-License-Identifier: Apache-2.0
// What a backend does for a training over several ranks, each of which holds a part of the Gaussians
// (docs/math/ranks.md).
#pragma once

#include <vector>

#include "kernels/blend/residual_score.h"
#include "kernels/core/parallel.h"
#include "kernels/ranks/dealt_rows.h"
#include "kernels/ranks/rank_array.h"
#include "kernels/ranks/view_report.h"
#include "kernels/requests.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The splats of some Gaussians in one view, in the order of their rows.
struct ProjectedView {
    /// Makes an empty one in the memory of `device`, or of the host where that is null.
    explicit ProjectedView(RankDevice* device = nullptr) : splats(device), rows(device), places(device) {}

    RankArray<WireSplat> splats;
    RankArray<std::uint32_t> rows;       ///< of the splats, but not of a step's on a device
    RankArray<SplatPlaces> places;       ///< of a step's on a device: (Gaussians / 32, rounded up)
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

/// Places in memory that the device uses for other things at other times; null where there are none.
struct ScratchPlaces {
    std::byte* splats = nullptr;  ///< what lies here is lost when loss_of_splats() has read its splats
    std::byte* sums = nullptr;    ///< this is free when loss_of_splats() writes sums, and then until the next view
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
/// sums of a step, reports on its views and the gradients of shared weights lie in the memory of device(); other sums
/// in the host's.
class Shard {
  public:
    /// Returns the device on which the rank computes, which lives as long as the backend; null where that is the host.
    virtual RankDevice* device() { return nullptr; }

    /// Begins to compute the splats of the rank's Gaussians that touch a tile of the view: for a step, or for a frame,
    /// which may read residuals in half precision. A device is at work on it until end_projection().
    virtual void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) = 0;
    /// Writes the splats of the projection that was begun, the only one, and begins the report on the view unless that
    /// is null.
    virtual void end_projection(ProjectedView& out, ViewReport* report) = 0;
    /// Does the same without waiting for a device: writes `room` splats. Those beyond it are left out, and what they
    /// leave free reaches no pixel.
    virtual void end_projection(ProjectedView& out, std::size_t room, ViewReport* report) = 0;
    /// Makes room for the next view that is rendered for a step, of `splats` splats, and returns places for `placed`
    /// splats, also of other views, and for as many sums. Unless the view is the `first` one, sums of the last are on
    /// their way; unless it is the `last` one, there are projections before update_rows().
    virtual ScratchPlaces room_for_splats(const CameraParams<float>&, std::size_t /*splats*/, std::size_t /*placed*/,
                                          bool /*first*/, bool /*last*/) {
        return {};
    }
    /// Does what order_on_host() says, where the arrays lie.
    virtual void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RankRows>& of_ranks,
                               RankArray<WireSplat>& out) = 0;

    /// Renders a view as Backend::render does.
    virtual void render_splats(const SplatParts& splats, const RenderRequest& request, RenderedImage& out) = 0;
    /// Begins to compute the loss of a view and the gradient sums of each splat, which mean nothing if the loss is not
    /// finite. Adds the gradient of the view's PPISP to `isp_gradient` (PpispState::size()) where it learns. `sums` may
    /// lie in the memory of `splats`: they are resized after the last use of these. Adds the loss to `report`.
    virtual void loss_of_splats(const SplatParts& splats, const StepRequest& request,
                                const SumParts<SplatSums<float>>& sums, std::vector<float>& isp_gradient,
                                ViewReport* report) = 0;
    /// Judges the step whose views `reports` are on, (ranks, views) by all ranks (verdict_on). A device does so when it
    /// comes there, and takes part in no step from one on that has to be repeated until take_back().
    virtual void judge(const RankArray<ViewReport>& reports) = 0;
    /// Waits for the oldest judgement that was not read yet, and returns the reports that it is made on.
    virtual std::vector<ViewReport> read_reports() = 0;
    /// Notes what was reported on a training view, which any rank may render next. Where this rank rendered it there is
    /// room for its instances then.
    virtual void note_view(std::int64_t /*id*/, const ViewReport&, bool /*rendered_here*/) {}
    /// Takes back the counts of the steps from the oldest on that has to be repeated, on `num_views` views together.
    virtual void take_back(std::int64_t num_views) = 0;
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
    /// splats that were projected and what was computed of them, if the last judgement was to take it. Counts it in any
    /// case. `num_gaussians` counts those of all ranks. Writes the gradient of the shared weights by the rank's
    /// Gaussians, shared_row() values, which mean nothing in a step that is not taken. A device may still be at work
    /// when the function returns.
    virtual void update_rows(const std::vector<StepRequest>& views, const std::vector<ProjectedView>& projected,
                             const std::vector<RankArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                             RankArray<float>& shared_gradient) = 0;
    /// Takes the step of the shared weights after update_rows(), on the same condition. `shared_gradients` (ranks,
    /// shared_row()) are those of all ranks, which are added up in their order.
    virtual void update_shared_weights(const std::vector<StepRequest>& views,
                                       const RankArray<float>& shared_gradients) = 0;
    /// Takes the step of PPISP, or only counts it where the step was skipped. `gradient` is that of all ranks.
    virtual void update_ppisp(const std::vector<StepRequest>& views, std::vector<float>& gradient, bool taken) = 0;
    /// Returns what was left out since the last call.
    virtual LeftOut take_nonfinite() = 0;

    /// Removes the rows that `rows` (ascending) does not name.
    virtual void keep_rows(const std::vector<std::uint32_t>& rows) = 0;

  protected:
    ~Shard() = default;
};

}  // namespace gs
