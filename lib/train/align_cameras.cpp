// SPDX-License-Identifier: Apache-2.0
// Takes steps of each view's pose against a model that does not learn.
#include "lib/train/align_cameras.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/median.h"
#include "lib/scene/camera_params.h"
#include "lib/train/pose_learner.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// How far a camera can go along each direction, pixels. The rate follows from it and from the number of steps.
constexpr double kAlignTravel = 12;
constexpr std::size_t kMeans = 5000;

std::vector<Eigen::Vector3d> some_means(Backend& backend) {
    const std::vector<float> means = backend.download(false)[Group::kMean].param;
    const std::size_t count = means.size() / 3, used = std::min(count, kMeans);
    std::vector<Eigen::Vector3d> points;
    for (std::size_t k = 0; k < used; ++k) {
        const float* p = &means[3 * (k * count / used)];
        points.emplace_back(p[0], p[1], p[2]);
    }
    return points;
}

}  // namespace

AlignedViews align_cameras(Backend& backend, std::vector<View> views, const Vec3<float>& background, int steps) {
    AlignedViews out{.views = std::move(views)};
    const std::vector<Eigen::Vector3d> points = some_means(backend);
    std::vector<double> pixels;
    for (View& view : out.views) {
        if (interrupted()) throw Interrupted("interrupted while cameras were aligned");
        PoseLearner pose(view.camera, points);
        const auto image = view_image(view);
        const double bound = largest_correction(view.camera);
        Camera camera = view.camera;
        StepStats best{.loss = std::numeric_limits<double>::infinity()};
        for (int step = 0; step < steps; ++step) {
            StepRequest request;
            request.camera = camera_params(camera);
            request.background = background;
            request.target = target_image(*image);
            request.isp.mode = IspMode::kFrame;
            request.isp.camera = std::max(0, view.camera_id);
            request.gather_camera_gradient = true;
            backend.step(request);
            const auto gradients = backend.take_camera_gradients();  // waits for the step, which the loss follows from
            if (const StepStats stats = backend.take_stats(); stats.loss < best.loss)
                best = stats, view.camera = camera;
            const double rate = falling_rate(2 * kAlignTravel / steps, double(step) / steps);
            for (const ViewCameraGradient& found : gradients)
                pose.step(camera, pose_gradient(camera, found.gradient), rate, 0, bound);
        }
        out.ssim.push_back(best.ssim);
        pixels.push_back(pose.pixels(pose.start(), view.camera));
    }
    if (!pixels.empty()) out.median_pixels = median(std::move(pixels));
    return out;
}

}  // namespace gs
