// SPDX-License-Identifier: Apache-2.0
// Collects the options that decide what a training makes, as texts.
#include "eval/runs/training_options.h"

#include <algorithm>
#include <filesystem>
#include <vector>

#include "lib/core/options.h"
#include "lib/core/run_config.h"

namespace gs {
namespace {

/// Returns whether runs of one experiment may differ in this option: it changes nothing of the model (to the bit, on
/// the CPU), or chance alone. `source` is compared by the place that it names.
bool is_immaterial(const Option& option) {
    static const std::vector<std::string> keys = {"source",
                                                  "model",
                                                  "image-cache",
                                                  "overwrite",
                                                  "resume",
                                                  "seed",
                                                  "test-iterations",
                                                  "save-iterations",
                                                  "checkpoint-iterations",
                                                  "checkpoint-minutes",
                                                  "preview-every",
                                                  "verify-images"};
    return option.group == "Logging" || std::find(keys.begin(), keys.end(), option.key) != keys.end();
}

}  // namespace

std::map<std::string, std::string> training_options(const TrainOptions& named) {
    const TrainOptions options = with_absolute_paths(named);
    std::map<std::string, std::string> texts;
    for (const Option& option : train_option_table())
        if (!is_immaterial(option)) texts[option.key] = option_text(option, options);
    const bool builtin = options.source.starts_with("builtin:");
    std::error_code error;
    const auto resolved = std::filesystem::weakly_canonical(options.source, error);
    texts["source"] = builtin || error ? options.source : resolved.string();
    return texts;
}

}  // namespace gs
