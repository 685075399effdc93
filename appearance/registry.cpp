// SPDX-License-Identifier: Apache-2.0
// The list of models that CMake found, and its lookup functions.
#include <algorithm>

#include "appearance/model_info.h"
#include "appearance/packing.h"
#include "appearance_registry.inc"
#include "kernels/base/error.h"

namespace gs {

std::vector<std::string> appearance_names() {
    std::vector<std::string> names;
    for (const ModelInfo* model : appearance_models()) names.push_back(model->name);
    return names;
}

const ModelInfo& appearance_model(const std::string& name) {
    std::string known;
    for (const ModelInfo* model : appearance_models()) {
        if (model->name == name) return *model;
        known += (known.empty() ? "" : ", ") + model->name;
    }
    throw UsageError("unknown appearance model '" + name + "'; known: " + known);
}

AppearanceSpec plain_sh_appearance(int degree) {
    const ModelInfo* found = nullptr;
    for (const ModelInfo* model : appearance_models()) {
        const bool fits = model->plain_sh && model->max_degree_limit >= degree;
        if (fits && (!found || model->max_degree_limit < found->max_degree_limit)) found = model;
    }
    if (!found)
        throw UsageError("no appearance model is plain spherical harmonics of degree " + std::to_string(degree));
    return {found->name, degree, ColorActivation::kRelu};
}

const std::vector<ModelOption>& all_model_options() {
    static const std::vector<ModelOption> options = [] {
        std::vector<ModelOption> all;
        for (const ModelInfo* model : appearance_models()) {
            for (const ModelOption& option : model->options) {
                const bool known =
                    std::any_of(all.begin(), all.end(), [&](const ModelOption& o) { return o.key == option.key; });
                if (!known) all.push_back(option);
            }
        }
        return all;
    }();
    return options;
}

ModelOptionValues default_model_options() {
    ModelOptionValues values;
    for (const ModelOption& option : all_model_options()) values[option.key] = option.default_value;
    return values;
}

}  // namespace gs
