// SPDX-License-Identifier: Apache-2.0
// The list of models CMake found, and look-up by name.
#include "appearance/model_info.h"
#include "kernels/core/error.h"

#include "appearance_registry.inc"

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

}  // namespace gs
