// SPDX-License-Identifier: Apache-2.0
// Opens the folder of a new or resumed run.
#include "lib/train/run_start.h"

#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/io/safetensors.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

std::filesystem::path resumed_file(const TrainOptions& options) {
    return options.resume == "latest" ? latest_checkpoint(options.model) : std::filesystem::path(options.resume);
}

}  // namespace

void require_free_folder(const TrainOptions& options) {
    if (RunLock::is_held(options.model)) const RunLock refused(options.model);  // says which process writes there
    std::optional<std::int64_t> iteration;
    if (!options.resume.empty()) iteration = read_checkpoint_iteration(resumed_file(options));
    require_free_run_folder({options.model}, options.overwrite, iteration);
}

std::filesystem::path resumed_run(const TrainOptions& options) {
    return absolute_path(resumed_file(options).parent_path().parent_path().string());
}

std::string checkpoint_appearance(const TrainOptions& options) {
    return SafetensorsFile(resumed_file(options)).metadata("appearance");
}

Frame checkpoint_frame(const TrainOptions& options) { return read_checkpoint_frame(resumed_file(options)); }

RunStart open_run(const TrainOptions& options) {
    RunStart start{RunFolder{options.model}, std::nullopt};
    if (!options.resume.empty()) {
        const auto file = resumed_file(options);
        start.checkpoint = read_checkpoint(file);
        require_same_appearance(start.checkpoint->state.appearance, appearance_spec(options), file.string());
    }
    if (!start.checkpoint && !options.init.empty()) start.initial = read_initial_model(options.init);
    const auto iteration = start.checkpoint ? std::optional(start.checkpoint->iteration) : std::nullopt;
    start.lock = std::make_shared<const RunLock>(start.folder.root);
    prepare_run_folder(start.folder, options.overwrite, iteration);
    // The end may come at an earlier iteration than in a part that was trained before.
    const bool may_end_earlier = start.checkpoint && !ends_by_iterations(options);
    if (options.overwrite || may_end_earlier) replace_earlier_run(start.folder, run_config(options), iteration);
    return start;
}

}  // namespace gs
