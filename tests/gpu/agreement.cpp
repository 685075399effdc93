// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/agreement.h"

namespace gs::test {

void expect_images_within_bounds(Backend& backend, const TestScene& scene) {
    backend.upload(scene.model);
    RenderRequest r;
    r.camera = scene.camera, r.background = scene.background;
    const std::pair<RenderMode, const char*> modes[] = {
        {RenderMode::kFull, "image"}, {RenderMode::kBaseOnly, "base colours"}, {RenderMode::kResidualOnly, "residual"}};
    for (const auto& [mode, name] : modes) {
        if (mode != RenderMode::kFull && scene.camera.width > 1000) continue;  // modes differ in colours only
        r.mode = mode;
        RenderedImage image;
        backend.render(r, image);
        const RenderReference want = reference_render(scene.model, r);
        ASSERT_EQ(image.width, scene.camera.width);
        ASSERT_EQ(image.height, scene.camera.height);
        ASSERT_EQ(image.rgb.size(), want.rgb.size());
        ASSERT_EQ(image.alpha.size(), want.alpha.size());
        Agreement rgb(name), alpha("alpha");
        for (std::size_t i = 0; i < want.rgb.size(); ++i) rgb.add(image.rgb[i], want.rgb[i]);
        for (std::size_t i = 0; i < want.alpha.size(); ++i) alpha.add(image.alpha[i], want.alpha[i]);
        rgb.expect(scene.rounding_share);
        if (mode == RenderMode::kFull) alpha.expect(scene.rounding_share);
        std::printf("  %lld of %zu pixels with a fragment that may count or not\n", (long long)want.undecided_pixels,
                    want.alpha.size());
    }
}

namespace {

/// Compares one step from zero moments, after which m = 0.1 g, v = 0.001 g^2 and the parameter has moved by
/// rate * sign(g).
void expect_step(Backend& backend, const TestScene& scene, const StepRequest& r, const StepReference& want,
                 const std::vector<char>& seen) {
    backend.upload(scene.model);
    backend.step(r);
    backend.synchronize();
    const StepStats stats = backend.take_stats();
    const Gaussians after = backend.download(true);
    const std::int64_t n = scene.model.count;
    EXPECT_EQ(stats.steps, 1);
    EXPECT_EQ(stats.num_nonfinite_gradients, 0);
    EXPECT_EQ(after.step, 1);
    ASSERT_EQ(after.count, n);
    Agreement loss("loss");
    loss.add(stats.loss, want.loss), loss.add(stats.l1, want.l1), loss.add(stats.ssim, want.ssim);
    loss.expect(1e-3);

    for (int k = 0; k < kNumGroups; ++k) {
        const auto &before = scene.model.groups[k], &now = after.groups[k];
        ASSERT_EQ(now.param.size(), before.param.size());
        ASSERT_EQ(now.m.size(), before.param.size());
        ASSERT_EQ(now.v.size(), before.param.size());
        Agreement m(std::string("m of ") + kGroupNames[k]), v(std::string("v of ") + kGroupNames[k]), p(kGroupNames[k]);
        std::int64_t certain = 0, moving = 0;
        for (std::size_t i = 0; i < before.param.size(); ++i) {
            const Rounded g = want.gradient[k][i];
            const double size = std::abs(g.v), rate = r.rates.groups[k];
            // m = 0.1 g and v = 0.001 g^2: the factor, the product and the fma are rounded.
            m.add(now.m[i], {0.1 * g.v, 0.1 * g.e + 4 * kRoundoff * 0.1 * size + kFlushed});
            v.add(now.v[i],
                  {1e-3 * g.v * g.v, 1e-3 * (2 * size + g.e) * g.e + 8 * kRoundoff * 1e-3 * size * size + kFlushed});
            // p - rate m / (sqrt(v) + 1e-15), both without their bias: whatever g is, it cancels but for its sign. 16
            // roundings, and that of p. Where the sign is not certain, p moves by at most the rate; where g is exactly
            // zero it stays.
            const double p0 = before.param[i], rounding = 2 * kRoundoff * (std::abs(p0) + rate);
            moving += size > 0;
            if (size == 0 && g.e == 0) {
                p.add(now.param[i], {p0, 0});
            } else if (size > std::max(4 * g.e, 1e-12)) {
                p.add(now.param[i], {p0 - rate * g.v / (size + 1e-15),
                                     16 * kRoundoff * rate + rate * 1e-15 * g.e / (size * size) + rounding});
                ++certain;
            } else {
                p.add(now.param[i], {p0, rate * (1 + 16 * kRoundoff) + rounding});
            }
        }
        const double rounding_share = scene.round && Group(k) == Group::kRotation ? 1e30 : scene.rounding_share;
        m.expect(rounding_share, kBeyond), v.expect(rounding_share, kBeyond), p.expect(1, kBeyond);
        std::printf("  %-22s sign certain for %lld of %lld that move\n", kGroupNames[k], (long long)certain,
                    (long long)moving);
    }
    ASSERT_EQ(after.gradient_sum.size(), std::size_t(n));
    Agreement statistic("statistic");
    for (std::int64_t i = 0; i < n; ++i) {
        statistic.add(after.gradient_sum[i], want.statistic[i]);
        // Tiles differ in size: an ellipse between pixel centres may touch one in one backend only. It adds nothing to
        // the sum then.
        EXPECT_TRUE(after.gradient_count[i] == 1 || (after.gradient_count[i] == 0 && !seen[i])) << "Gaussian " << i;
    }
    statistic.expect(scene.rounding_share, kBeyond);
}

}  // namespace

void expect_step_within_bounds(const std::vector<Backend*>& backends, const TestScene& scene) {
    RandomTarget target(scene.camera.width, scene.camera.height, scene.channels, scene.masked, scene.floats);
    if (scene.clear_from) target.clear_from(*scene.clear_from);
    StepRequest r = step_request(scene.camera, target.image());
    r.background = scene.background;
    const StepReference want = reference_step(scene.model, r);
    const std::vector<char> seen = reference_render(scene.model, {r.camera, r.background, RenderMode::kFull}).seen;
    for (Backend* backend : backends) {
        SCOPED_TRACE(backend->describe());
        expect_step(*backend, scene, r, want, seen);
    }
}

}  // namespace gs::test
