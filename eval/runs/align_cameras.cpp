// SPDX-License-Identifier: Apache-2.0
// Takes steps of each view's pose against a model that does not learn.
#include "eval/runs/align_cameras.h"

#include <algorithm>

#include "lib/core/median.h"
#include "lib/scene/camera_params.h"
#include "lib/train/pose_learner.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

constexpr int kSteps = 80;
constexpr double kFirstRate = 0.4;  ///< pixels
constexpr std::size_t kPoints = 5000;

std::vector<Eigen::Vector3d> some_means(Backend& backend) {
    const std::vector<float> means = backend.download(false)[Group::kMean].param;
    const std::size_t count = means.size() / 3, used = std::min(count, kPoints);
    std::vector<Eigen::Vector3d> points;
    for (std::size_t k = 0; k < used; ++k) {
        const float* p = &means[3 * (k * count / used)];
        points.emplace_back(p[0], p[1], p[2]);
    }
    return points;
}

}  // namespace

AlignedViews align_test_cameras(Backend& backend, const Scene& scene, const Vec3<float>& background) {
    AlignedViews out{scene.test};
    const std::vector<Eigen::Vector3d> points = some_means(backend);
    std::vector<double> pixels;
    for (View& view : out.views) {
        PoseLearner pose(view.camera, points);
        const auto image = view_image(view);
        const double bound = largest_correction(view.camera);
        for (int step = 0; step < kSteps; ++step) {
            StepRequest request;
            request.camera = camera_params(view.camera);
            request.background = background;
            request.target = target_image(*image);
            request.isp.mode = IspMode::kFrame;
            request.isp.camera = std::max(0, view.camera_id);
            request.gather_camera_gradient = true;
            backend.step(request);
            const double rate = falling_rate(kFirstRate, double(step) / kSteps);
            for (const ViewCameraGradient& found : backend.take_camera_gradients())
                pose.step(view.camera, pose_gradient(view.camera, found.gradient), rate, bound);
        }
        pixels.push_back(pose.way_to(view.camera).norm());
    }
    if (!pixels.empty()) out.median_pixels = median(std::move(pixels));
    return out;
}

}  // namespace gs
