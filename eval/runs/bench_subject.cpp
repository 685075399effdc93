// SPDX-License-Identifier: Apache-2.0
// Reads a trained model, or makes the initial one.
#include "eval/runs/bench_subject.h"

#include <fmt/format.h>

#include "eval/bench/bench.h"
#include "eval/runs/saved_run.h"
#include "kernels/base/error.h"
#include "lib/model/limit_values.h"
#include "lib/train/scene_options.h"

namespace gs {

BenchSubject bench_subject(const TrainOptions& options, std::optional<std::int64_t> iteration) {
    const bool trained = holds_model(options.model);
    if (iteration && !trained)
        throw UsageError("--iteration: there is no trained model in '" + options.model + "'; name its folder with -m");
    BenchSubject subject{options.source + ", initial points", {}, {}};
    if (trained) {  // read first: a mistake here should not wait for the scene
        SavedModel saved = read_saved_model(options.model, iteration);
        subject.scene = load_scene_of(saved, options);
        subject.model = std::move(saved.state);
        make_trainable(subject.model);  // iterations are measured, too
        subject.model.active_degree = subject.model.appearance.max_degree;
        subject.name = fmt::format("{}, {}", options.source, options.model);
        if (!is_point_cloud(options.model)) subject.name += fmt::format(" at iteration {}", saved.iteration);
    }
    if (!trained) subject.scene = load_scene(scene_options(options));
    if (subject.scene.train.empty())
        throw DataError(subject.scene.source + ": no training views (all were held out or skipped)");
    if (!trained) subject.model = initial_model(options, subject.scene);
    return subject;
}

}  // namespace gs
