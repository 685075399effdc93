// SPDX-License-Identifier: Apache-2.0
// An engine that renders one given colour per camera, so that evaluation can be tested without a model.
#pragma once

#include "tests/kernels/forwarding_engine.h"

namespace gs::test {

/// Paints every pixel with red = `camera.translation.x`, green = background, blue = 0; a base 0.2, a residual 0.5.
class FakeEngine : public ForwardingEngine {
  public:
    FakeEngine() : ForwardingEngine({"none", 0, ColorActivation::kRelu}) {
        traits_.device = "fake";
        traits_.ceilings = [] { return Ceilings{1e9, 1e9}; };
    }
    RowCounts counts() const override { return {7, 7}; }
    void render(const RenderRequest& request, const SplatParts*, RenderedImage& out) override {
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
    std::optional<double> time_frames(const std::vector<RenderRequest>&, int) override { return 0; }
};

}  // namespace gs::test
