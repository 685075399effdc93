// SPDX-License-Identifier: Apache-2.0
// Which numbers the parameters of a model may have. Converters write infinities for what is fully opaque or flat.
#pragma once

#include <cstdint>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns whether a raw parameter of the group has a meaning: it is finite, or an infinity whose activation has a
/// limit. An opacity of +-infinity is 1 or 0, and a log scale of -infinity is an axis without extent.
bool has_meaning(Group group, float raw);

/// Replaces infinite parameters, which have no gradient, by finite ones that a training can begin with: the largest
/// opacity that trainings keep (kMaxRawOpacity), its opposite, and the least scale that files for viewers hold. Returns
/// the number of Gaussians that were changed.
std::int64_t make_trainable(Gaussians& gaussians);

}  // namespace gs
