// SPDX-License-Identifier: Apache-2.0
// The CPU backend behind a layer that tests override: devices that fail, run behind, or are only watched.
#pragma once

#include "kernels/backend.h"

namespace gs::test {

/// Passes every call on to another backend.
class ForwardingBackend : public Backend, public BackendTimer {
  public:
    explicit ForwardingBackend(const AppearanceSpec& appearance) : inner_(make_cpu_backend(appearance)) {}
    std::string describe() const override { return inner_->describe(); }
    void upload(const Gaussians& state) override { inner_->upload(state); }
    Gaussians download(bool with_moments) override { return inner_->download(with_moments); }
    std::int64_t count() const override { return inner_->count(); }
    void set_active_degree(int degree) override { inner_->set_active_degree(degree); }
    void upload_ppisp(const PpispState& state) override { inner_->upload_ppisp(state); }
    PpispState download_ppisp() override { return inner_->download_ppisp(); }
    void render(const RenderRequest& request, RenderedImage& out) override { inner_->render(request, out); }
    void step(const StepRequest& request) override { inner_->step(request); }
    void distill(const StepRequest& request) override { inner_->distill(request); }
    StepStats take_stats() override { return inner_->take_stats(); }
    void synchronize() override { inner_->synchronize(); }
    double time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        return inner_->timer().time_frames(views, repeats);
    }
    int stage_passes() const override { return inner_->timer().stage_passes(); }
    void measure_stages(std::optional<int> pass) override { inner_->timer().measure_stages(pass); }
    std::vector<StageCost> take_stage_costs() override { return inner_->timer().take_stage_costs(); }
    Ceilings measure_ceilings() override { return inner_->timer().measure_ceilings(); }
    MemoryUse memory() override { return inner_->memory(); }
    BackendTimer& timer() override { return *this; }
    DensifyStats densify(const DensifyRequest& request) override { return inner_->densify(request); }
    void reset_opacity() override { inner_->reset_opacity(); }
    std::vector<float> scores(const std::vector<RenderRequest>& views) override { return inner_->scores(views); }
    std::int64_t num_residuals() const override { return inner_->num_residuals(); }
    double squared_error(const StepRequest& view) override { return inner_->squared_error(view); }
    ResidualScores residual_scores(std::size_t num_views, const StepSource& step_on) override {
        return inner_->residual_scores(num_views, step_on);
    }
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override {
        inner_->keep_residuals(marks, bases);
    }
    PruneStats prune(const PruneRequest& request) override { return inner_->prune(request); }
    void morton_sort() override { inner_->morton_sort(); }

  private:
    std::unique_ptr<Backend> inner_;
};

}  // namespace gs::test
