// SPDX-License-Identifier: Apache-2.0
// A model that several ranks train together, as a Backend on rank 0. Each call is sent to the other ranks, which follow
// it, and does rank 0's part of it. So everything that decides something runs on rank 0 alone.
#pragma once

#include <memory>

#include "kernels/backend.h"
#include "kernels/ranks/link_speed.h"
#include "kernels/ranks/message.h"
#include "kernels/ranks/rank_worker.h"

namespace gs {

/// What a rank holds, and the costs of its steps since the last report.
struct RankReport {
    RankCosts costs;
    std::int64_t rows = 0;
    std::int64_t device_bytes = 0;    ///< Backend::memory(); 0 on the CPU
    std::int64_t resident_bytes = 0;  ///< of the process, at the time of the report
};

class RankedBackend : public Backend, private BackendTimer {
  public:
    /// Takes rank 0's own backend, and trains on `views_per_step` views in a step. `ranks` must outlive the object.
    RankedBackend(Communicator& ranks, std::unique_ptr<Backend> own, int views_per_step);
    /// Tells the other ranks that there is nothing more to follow, or ends the connection if a call failed halfway.
    ~RankedBackend() override;

    std::string describe() const override;
    int views_per_step() const override { return views_per_step_; }
    bool needs_pixels(int k) const override { return k % ranks_.size() == 0; }
    void upload(const Gaussians& state) override;
    Gaussians download(bool with_moments) override;
    std::int64_t count() const override { return worker_.num_gaussians(); }
    void set_active_degree(int degree) override;
    void upload_ppisp(const PpispState& state) override;
    PpispState download_ppisp() override {
        finish_steps();
        return own_->download_ppisp();
    }
    void render(const RenderRequest& request, RenderedImage& out) override;
    int views_at_once() const override { return ranks_.size(); }
    void render_all(const std::vector<RenderRequest>& views, std::vector<RenderedImage>& out) override;
    void step(const StepRequest& request) override { step_on({request}); }
    void step_on(const std::vector<StepRequest>& views) override;
    void distill(const StepRequest& request) override;
    StepStats take_stats() override;
    void synchronize() override {
        finish_steps();
        own_->synchronize();
        all_steps_done_ = true;
    }
    MemoryUse memory() override { return own_->memory(); }
    BackendTimer& timer() override { return *this; }
    DensifyStats densify(const DensifyRequest& request) override;
    void reset_opacity() override;
    std::vector<float> scores(const std::vector<RenderRequest>& views) override;
    std::int64_t num_residuals() const override;
    ResidualScores residual_scores(std::size_t num_views, const StepSource& step_on) override;
    double squared_error(const StepRequest& view) override;
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override;
    PruneStats prune(const PruneRequest& request) override;
    void morton_sort() override;

    /// Returns rank 0's costs of the steps since the last call of this or of take_reports().
    RankCosts take_costs() { return worker_.take_costs(); }
    /// Returns the reports of all ranks, by rank.
    std::vector<RankReport> take_reports();
    /// Measures the connection between the ranks (measure_link).
    LinkSpeed measure_connection();

  private:
    double time_frames(const std::vector<RenderRequest>& views, int repeats) override;
    void measure_stages(std::optional<int>) override {}
    std::vector<StageCost> take_stage_costs() override { return own_->timer().take_stage_costs(); }
    Ceilings measure_ceilings() override { return own_->timer().measure_ceilings(); }

    /// Sends a command to the other ranks and does rank 0's own part of it. After a failure nothing more is sent.
    template <class Fn> auto on_all(const MessageWriter& command, Fn&& own_part);
    /// The same for all but steps, which are finished first.
    template <class Fn> auto together(const MessageWriter& command, Fn&& own_part);
    /// Lets all ranks finish their steps.
    void finish_steps();
    void deal_anew_if_uneven();

    Communicator& ranks_;
    const std::unique_ptr<Backend> own_;
    const int views_per_step_;
    RankWorker worker_;
    bool all_steps_done_ = false;  ///< synchronize() was called after the last step
    bool lost_ = false;
    bool controllers_differ_ = false;  ///< rank 0 alone has trained them
};

/// Follows the commands of rank 0 with this rank's `backend` until they end. `targets` brings the images of the views
/// that this rank renders.
void follow(Communicator& ranks, Backend& backend, const TargetSource& targets);

}  // namespace gs
