// SPDX-License-Identifier: Apache-2.0
// A backend that renders one given colour per camera, so that evaluation can be tested without a model.
#pragma once

#include "kernels/backend.h"

namespace gs::test {

/// Paints every pixel with red = `camera.translation.x`, green = background, blue = 0; a base 0.2, a residual 0.5.
class FakeBackend : public Backend, public BackendTimer {
  public:
    std::string describe() const override { return "fake"; }
    void upload(const Gaussians&) override {}
    Gaussians download(bool) override { return {}; }
    std::int64_t count() const override { return 7; }
    void set_active_degree(int) override {}
    void upload_ppisp(const PpispState&) override {}
    PpispState download_ppisp() override { return {}; }
    void render(const RenderRequest& request, RenderedImage& out) override {
        out.width = request.camera.width, out.height = request.camera.height;
        const std::size_t pixels = std::size_t(out.width) * out.height;
        out.rgb.assign(3 * pixels, 0);
        out.alpha.assign(pixels, 1);
        const float blue = request.mode == RenderMode::kBaseOnly       ? 0.2f
                           : request.mode == RenderMode::kResidualOnly ? 0.5f
                                                                       : 0.0f;
        for (std::size_t i = 0; i < pixels; ++i) {
            out.rgb[i] = request.camera.translation.x, out.rgb[pixels + i] = request.background.y,
            out.rgb[2 * pixels + i] = blue;
        }
    }
    void step(const StepRequest&) override {}
    void distill(const StepRequest&) override {}
    StepStats take_stats() override { return {}; }
    void synchronize() override {}
    double time_frames(const std::vector<RenderRequest>&, int) override { return 0; }
    void measure_stages(std::optional<int>) override {}
    std::vector<StageCost> take_stage_costs() override { return {}; }
    Ceilings measure_ceilings() override { return {1e9, 1e9}; }
    MemoryUse memory() override { return {}; }
    BackendTimer& timer() override { return *this; }
    DensifyStats densify(const DensifyRequest&) override { return {}; }
    void reset_opacity() override {}
    std::vector<float> scores(const std::vector<RenderRequest>&) override { return {}; }
    PruneStats prune(const PruneRequest&) override { return {}; }
    void morton_sort() override {}
    std::int64_t num_residuals() const override { return count(); }
    ResidualScores residual_scores(std::size_t, const StepSource&) override { return {}; }
    double squared_error(const StepRequest&) override { return 0; }
    void keep_residuals(const std::vector<std::uint8_t>&, const std::vector<float>&) override {}
};

}  // namespace gs::test
