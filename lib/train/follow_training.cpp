// SPDX-License-Identifier: Apache-2.0
// Gives all ranks the same views, and follows rank 0 through a training.
#include "lib/train/follow_training.h"

#include <fmt/format.h>

#include <map>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/ranks/message.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/version.h"
#include "lib/scene/scene.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"
#include "lib/train/step_composer.h"
#include "lib/train/training_views.h"

namespace gs {
namespace {

/// Returns the build, the kind of device and all options on which ranks must agree, one per line.
std::string agreed_text(const TrainOptions& options) {
    std::string text = version_text() + "\n" + (uses_cuda(options.device) ? "a GPU\n" : "the CPU\n");
    for (const Option& option : train_option_table())
        if (option.scope != Scope::kMachine) text += "--" + option.key + " " + option_text(option, options) + "\n";
    return text;
}

/// Writes name and size of the views that rank 0 trains on.
void put_views(MessageWriter& message, const Scene& scene) {
    message.put(std::uint64_t(scene.train.size()));
    for (const View& view : scene.train) message.put(view.name).put(view.camera.width).put(view.camera.height);
}

/// Reads the list of views that rank 0 trains on, and reduces `scene` to these views in that order. Throws DataError if
/// a view is missing on this rank or has another size.
void take_views(MessageReader& message, Scene& scene) {
    std::map<std::string, View> found;
    for (View& view : scene.train) found.emplace(view.name, std::move(view));
    scene.train.clear();
    for (auto count = message.get<std::uint64_t>(); count > 0; --count) {
        std::string name;
        message.get(name);
        const int width = message.get<int>(), height = message.get<int>();
        const auto view = found.find(name);
        if (view == found.end())
            throw DataError(fmt::format("{}: the image {} is missing, which rank 0 trains on", scene.source, name));
        const Camera& camera = view->second.camera;
        if (camera.width != width || camera.height != height)
            throw DataError(fmt::format("{}: the image {} has {}x{} pixels, and {}x{} for rank 0", scene.source, name,
                                        camera.width, camera.height, width, height));
        scene.train.push_back(view->second);
    }
}

/// The views of a training, from which a rank other than 0 reads the images of its steps.
struct TrainedScene {
    TrainedScene(const TrainOptions& run_options, const Scene& loaded, MessageReader& about)
        : options(run_options), scene(loaded) {
        about.get(options.seed);  // each of several runs has its own seed
        about.get(views_per_step);
        take_views(about, scene);
    }
    TrainOptions options;
    Scene scene;
    int views_per_step = 1;
    TrainingViews views{options, scene};
};

}  // namespace

void agree_on_options(RankGroup& group, const TrainOptions& options) { group.agree(agreed_text(options)); }

StepViews step_views(const TrainOptions& options, const Scene& scene, const RankGroup* group) {
    StepViews views{.per_step = views_of_step(options.batch, group)};
    views.about_targets.put(options.seed).put(views.per_step);
    put_views(views.about_targets, scene);
    return views;
}

void follow_training(RankGroup& group, TrainOptions options) {
    group.follow([&] {
        agree_on_options(group, options);
        options.threads = threads_of_rank(group, options.threads);
        set_num_threads(options.threads);
        const Scene loaded = load_scene(options);
        follow_backends(group, [&](MessageReader& about_targets) -> TargetSource {
            const auto trained = std::make_shared<TrainedScene>(options, loaded, about_targets);
            trained->views.set_views_per_step(trained->views_per_step,
                                              [&](int k) { return k % group.size() == group.rank(); });
            return [trained](StepRequest& request) {
                const auto image = trained->views.image_of_rank(request.target.id, request.iteration);
                const TargetImage target = target_image(*image, request.target.id);
                if (target.width != request.camera.width || target.height != request.camera.height)
                    throw DataError(fmt::format("the image {} has {}x{} pixels instead of {}x{}",
                                                trained->scene.train[std::size_t(request.target.id.view)].name,
                                                target.width, target.height, request.camera.width,
                                                request.camera.height));
                request.target = target;
                request.pixels = image;
            };
        });
    });
}

}  // namespace gs
