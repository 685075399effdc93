// SPDX-License-Identifier: Apache-2.0
// Makes the smaller scene.
#include "eval/auto/stage.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/auto/photograph.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/scene/resized.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"
#include "lib/train/model_limits.h"

namespace gs {
namespace {

/// Width in pixels to which wider images are reduced: differences between models appear sooner, in a fraction of the
/// time. (On lego sv, its best model, led sh by 0.22 dB after 2000 and 2000 iterations at 400 pixels, and by 0.07 after
/// 3000 and 1500 at 800 pixels with three times the Gaussians.)
constexpr int kStageWidth = 400;
/// Ratio of a step's time to a frame's time for the first Gaussians, including other measurements and room for growth.
constexpr double kStepPerFrame = 4.5;

}  // namespace

std::string plain_model() { return plain_sh_appearance(0).model; }

Stage make_stage(const TrainOptions& options, const Scene& scene) {
    Stage stage{scene, options, 1};
    stage.scene.train.clear(), stage.scene.test.clear();
    const auto pixels = [](const View& view) { return double(view.camera.width) * view.camera.height; };
    double small = 0, full = 0;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        View view = smaller_view(scene.train[k], kStageWidth);
        small += pixels(view), full += pixels(scene.train[k]);
        (is_held_out(k) ? stage.scene.test : stage.scene.train).push_back(std::move(view));
    }
    stage.pixels = small / full;
    stage.options.appearance = plain_model();
    stage.options.cap_max = std::max<std::int64_t>(1, std::llround(double(options.cap_max) * stage.pixels));
    return stage;
}

std::int64_t iterations_of(const TrainOptions& options, double share) {
    return std::max<std::int64_t>(1, std::llround(share * double(options.iterations)));
}

std::int64_t affordable_iterations(const Stage& stage, double seconds, double trainings) {
    const AppearanceSpec plain = appearance_spec(stage.options);
    const auto backend = make_backend(stage.options.device, plain, engine_options(stage.options));
    backend->upload(initialize_gaussians(stage.scene, plain, init_options(stage.options)));
    const double step = kStepPerFrame * ModelLimits(stage.options, stage.scene, {}, 0).view_seconds(*backend);
    return std::int64_t(seconds / (step * trainings));
}

}  // namespace gs
