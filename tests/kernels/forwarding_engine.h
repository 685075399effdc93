// SPDX-License-Identifier: Apache-2.0
// The CPU engine behind a layer that tests override: devices that fail, run behind, or are only watched.
#pragma once

#include "tests/kernels/backends.h"

namespace gs::test {

/// Passes every call on to another engine, but for what an engine need not have (scores, residual_scores).
class ForwardingEngine : public Engine {
  public:
    explicit ForwardingEngine(const AppearanceSpec& appearance) : inner_(make_cpu_engine(appearance)) {
        traits_ = inner_->traits();
    }
    MemoryUse memory() override { return inner_->memory(); }
    void synchronize() override { inner_->synchronize(); }
    void upload(const Gaussians& state) override { inner_->upload(state); }
    Gaussians download(Download what) override { return inner_->download(what); }
    RowCounts counts() const override { return inner_->counts(); }
    void set_active_degree(int degree) override { inner_->set_active_degree(degree); }
    void update_smoothing(const std::vector<CameraParams<float>>& cameras) override {
        inner_->update_smoothing(cameras);
    }
    void upload_ppisp(const PpispState& state) override { inner_->upload_ppisp(state); }
    DensifyStats densify(const DensifyRequest& request) override { return inner_->densify(request); }
    PruneStats prune(const PruneRequest& request) override { return inner_->prune(request); }
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override {
        inner_->keep_residuals(marks, bases);
    }

    void render(const RenderRequest& request, const SplatParts* splats, RenderedImage& out) override {
        inner_->render(request, splats, out);
    }
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        return inner_->time_frames(views, repeats);
    }
    void begin_projection(const CameraParams<float>& camera, RenderMode mode, bool for_step) override {
        inner_->begin_projection(camera, mode, for_step);
    }
    void end_projection(ProjectedView& out, std::optional<std::size_t> room, ViewReport* report) override {
        inner_->end_projection(out, room, report);
    }
    ScratchPlaces room_for_splats(const CameraParams<float>& camera, std::size_t splats, std::size_t placed, bool first,
                                  bool last) override {
        return inner_->room_for_splats(camera, splats, placed, first, last);
    }
    void order_by_rows(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                       DeviceArray<WireSplat>& out) override {
        inner_->order_by_rows(splats, rows, of_ranks, out);
    }
    double half_squared_error(const StepRequest& request, const SplatParts& splats) override {
        return inner_->half_squared_error(request, splats);
    }
    void scores_of_splats(const RenderRequest& request, const SplatParts& splats,
                          const SumParts<double>& scores) override {
        inner_->scores_of_splats(request, splats, scores);
    }
    void residual_sums_of_splats(const StepRequest& request, const SplatParts& splats,
                                 const SumParts<ResidualSplatSums>& sums) override {
        inner_->residual_sums_of_splats(request, splats, sums);
    }

    void step(const StepRequest& request) override { inner_->step(request); }
    void distill(const StepRequest& request, const SplatParts* splats) override { inner_->distill(request, splats); }
    StepStats take_stats() override { return inner_->take_stats(); }
    std::vector<ViewCameraGradient> take_camera_gradients() override { return inner_->take_camera_gradients(); }
    void loss_of_splats(const StepRequest& request, const SplatParts& splats, const SumParts<SplatSums<float>>& sums,
                        std::vector<float>& isp_gradient, ViewReport* report) override {
        inner_->loss_of_splats(request, splats, sums, isp_gradient, report);
    }
    void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                     const std::vector<ProjectedView>& projected,
                     const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                     DeviceArray<float>& shared_gradient) override {
        inner_->update_rows(reports, views, projected, sums, num_gaussians, shared_gradient);
    }
    void update_shared_weights(const std::vector<StepRequest>& views, const DeviceArray<float>& gradients) override {
        inner_->update_shared_weights(views, gradients);
    }
    std::vector<ViewReport> read_reports(const std::vector<ImageId>& ids, int rank) override {
        return inner_->read_reports(ids, rank);
    }
    void take_back(std::int64_t num_views) override { inner_->take_back(num_views); }
    std::vector<StageCost> measure_stages(std::optional<int> pass) override { return inner_->measure_stages(pass); }

  private:
    std::unique_ptr<Engine> inner_;
};

}  // namespace gs::test
