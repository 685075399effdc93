// SPDX-License-Identifier: Apache-2.0
// A PLY file rendered through the backend against the renderer without tiles.
#include <gtest/gtest.h>

#include "lib/model/ply.h"
#include "tests/core/temporary_folder.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

TEST(PlyRender, EqualsBruteForceToTheTruncationBound) {
    const TemporaryFolder folder;
    for (const int degree : {0, 1, 2, 3}) {
        const GaussianState<double> scene = random_gaussians(150, degree, 40 + std::uint32_t(degree));
        Gaussians stored = cast<float>(scene);
        stored.appearance.model = degree ? "sh" : "none";
        const auto path = folder.path() / ("degree" + std::to_string(degree) + ".ply");
        write_ply(path, stored, {});
        const auto backend = make_cpu_backend(read_ply(path).appearance);
        backend->upload(read_ply(path));

        const int width = 61, height = 47;
        RenderRequest request;
        request.camera = cast<float>(test_camera(width, height));
        request.background = {0.25f, 0.5f, 0.75f};
        RenderedImage image;
        backend->render(request, image);

        const BruteForce brute(scene, test_camera(width, height));
        const double max_color = std::max(1.0, brute.max_color());
        double worst = 0, worst_same = 0;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const std::size_t i = std::size_t(y) * width + x, plane = std::size_t(width) * height;
                const auto error = [&](const BruteForcePixel& p) {
                    return std::max({std::abs(image.rgb[i] - p.color.x), std::abs(image.rgb[i + plane] - p.color.y),
                                     std::abs(image.rgb[i + 2 * plane] - p.color.z)});
                };
                // Leaving out a fragment changes a pixel by at most alpha times the largest colour, stopping at
                // T < 1e-4 by that much of it; 5e-5 is for parameters and arithmetic in float.
                const Vec3<double> background{0.25, 0.5, 0.75};
                const BruteForcePixel exact = brute.pixel(x, y, background, false);
                const double bound = (exact.dropped_alpha + 1e-4) * max_color + 5e-5;
                EXPECT_LE(error(exact), bound) << x << "," << y;
                worst = std::max(worst, error(exact) / bound);
                const BruteForcePixel same = brute.pixel(x, y, background, true);
                if (same.threshold_distance > 1e-3) worst_same = std::max(worst_same, error(same));
            }
        EXPECT_LE(worst_same, 5e-5);
        std::printf("degree %d: %.0f %% of the bound; with the same truncation %.1e\n", degree, 100 * worst,
                    worst_same);
    }
}

}  // namespace
}  // namespace gs::test
