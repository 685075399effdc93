// SPDX-License-Identifier: Apache-2.0
// What an appearance model is called, and how colours are activated.
#pragma once

#include <string>

namespace gs {

/// Colour activation phi (docs/math/appearance.md#colour-activation).
enum class ColorActivation : int { kRelu, kSoftplus, kSigmoid, kHardSigmoid };

/// Which appearance model, at which size. Part of every checkpoint.
struct AppearanceSpec {
    std::string model = "sh";
    int max_degree = 3; ///< unit of the model: SH bands, sites, lobes (docs/math/appearance.md#degrees)
    ColorActivation activation = ColorActivation::kRelu;
};

}  // namespace gs
