// SPDX-License-Identifier: Apache-2.0
// The name and size of an appearance model, and the activation of colours.
#pragma once

#include <string>

namespace gs {

/// The colour activation phi (docs/math/appearance.md#colour-activation).
enum class ColorActivation : int { kRelu, kSoftplus, kSigmoid, kHardSigmoid };

/// An appearance model and its size. Every checkpoint holds one.
struct AppearanceSpec {
    std::string model = "sh";
    int max_degree = 3;  ///< in the model's own unit: SH bands, sites, lobes (docs/math/appearance.md#degrees)
    ColorActivation activation = ColorActivation::kRelu;
};

}  // namespace gs
