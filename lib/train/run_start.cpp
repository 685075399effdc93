// SPDX-License-Identifier: Apache-2.0
// Opens the folder of a new or resumed run.
#include "lib/train/run_start.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/io/safetensors.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

std::filesystem::path resumed_file(const TrainOptions& options) {
    return options.resume == "latest" ? latest_checkpoint(options.model) : std::filesystem::path(options.resume);
}

/// Throws DataError if the resumed run would score other views than the run held out. A missing image shifts all later
/// test views of "every 8th", so that training views would be scored.
void require_same_test_views(const Checkpoint& checkpoint, const std::string& test_views, const TrainOptions& options) {
    if (!options.eval || checkpoint.test_views.empty() || checkpoint.test_views == test_views) return;
    const auto number = [](const std::string& digest) { return digest.substr(0, digest.find(' ')); };
    throw DataError(fmt::format(
        "{}: its {} test views are not the {} that the run to resume held out; are images missing that were there "
        "before, or is --test-every another? Restore them, or start anew",
        options.source, number(test_views), number(checkpoint.test_views)));
}

/// Returns whether the run of this checkpoint had a target. Throws DataError if its options cannot be read.
bool had_target(const Checkpoint& checkpoint, const TrainOptions& options) {
    try {
        const YAML::Node target = YAML::Load(checkpoint.options_yaml)["target-psnr"];
        return target && target.as<double>() > 0;
    } catch (const YAML::Exception& e) {
        throw DataError(fmt::format("checkpoint {}: metadata options: {}", options.resume, e.what()));
    }
}

/// Throws UsageError if only one of checkpoint and options has a target, which holds out training views.
void require_same_training_views(const Checkpoint& checkpoint, const TrainOptions& options) {
    if (had_target(checkpoint, options) != options.target_psnr.has_value())
        throw UsageError(
            "option target-psnr: it holds training views out from the first step on; a run that was begun without it "
            "cannot be resumed with it, nor the other way round");
}

}  // namespace

void require_free_folder(const TrainOptions& options) {
    if (RunLock::is_held(options.model)) const RunLock refused(options.model);  // throws and names the process
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

RunStart open_run(const TrainOptions& options, const std::string& test_views) {
    RunStart start{RunFolder{options.model}, std::nullopt};
    if (!options.resume.empty()) {
        const auto file = resumed_file(options);
        start.checkpoint = read_checkpoint(file);
        require_same_appearance(start.checkpoint->state.appearance, appearance_spec(options), file.string());
        if (!test_views.empty()) require_same_test_views(*start.checkpoint, test_views, options);
        require_same_training_views(*start.checkpoint, options);
    }
    if (!start.checkpoint && !options.init.empty()) start.initial = read_initial_model(options.init);
    const auto iteration = start.checkpoint ? std::optional(start.checkpoint->iteration) : std::nullopt;
    start.lock = std::make_shared<const RunLock>(start.folder.root);
    prepare_run_folder(start.folder, options.overwrite, iteration);
    // A resumed run under a time limit may end before iterations that are already saved.
    const bool may_end_earlier = start.checkpoint && !options.ends_by_iterations();
    if (options.overwrite || may_end_earlier) replace_earlier_run(start.folder, run_config(options), iteration);
    return start;
}

}  // namespace gs
