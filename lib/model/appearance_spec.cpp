// SPDX-License-Identifier: Apache-2.0
// Checks the appearance of files and command lines against the registry of models.
#include "lib/model/appearance_spec.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/choices.h"

namespace gs {

std::string describe(const AppearanceSpec& spec) {
    return fmt::format("{}, max degree {}, {}", spec.model, spec.max_degree, word(spec.activation));
}

void require_same_appearance(const AppearanceSpec& found, const AppearanceSpec& wanted, const std::string& file) {
    if (found.model == wanted.model && found.max_degree == wanted.max_degree && found.activation == wanted.activation)
        return;
    throw UsageError(fmt::format(
        "'{}' holds the appearance ({}), but ({}) was asked for; use the same appearance options, or start a new run",
        file, describe(found), describe(wanted)));
}

AppearanceSpec appearance_spec(const AppearanceOptions& options) {
    const ModelInfo& info = appearance_model(options.appearance);
    AppearanceSpec spec;
    spec.model = info.name;
    spec.max_degree =
        info.degree_option.empty() ? info.default_max_degree : int(*options.model_options.at(info.degree_option));
    spec.activation = options.color_activation;
    return spec;
}

AppearanceSpec appearance_from_file(const std::string& file, const std::string& model, std::int64_t max_degree,
                                    const std::string& activation) {
    try {
        const ModelInfo& info = appearance_model(model);
        if (max_degree < 0 || max_degree > info.max_degree_limit) {
            throw UsageError(fmt::format("max_degree {} of appearance '{}' is outside 0..{}", max_degree, model,
                                         info.max_degree_limit));
        }
        const std::optional<ColorActivation> known = choice_of<ColorActivation>(activation);
        if (!known)
            throw UsageError(fmt::format("unknown colour activation '{}'; known: {}", activation,
                                         fmt::join(kWordsOf<ColorActivation>, ", ")));
        return {model, int(max_degree), *known};
    } catch (const UsageError& e) {
        // The names come from the file, not from the user, so the file is at fault.
        throw DataError(fmt::format("cannot read '{}': {}", file, e.what()));
    }
}

int group_width(Group group, const AppearanceSpec& spec) {
    switch (group) {
        case Group::kMean:
        case Group::kScale:
        case Group::kBase:
            return 3;
        case Group::kRotation:
            return 4;
        case Group::kOpacity:
            return 1;
        case Group::kResidual:
            return appearance_model(spec.model).residual_width(spec.max_degree);
        case Group::kSmoothing:
            return 0;
    }
    return 0;
}

}  // namespace gs
