// SPDX-License-Identifier: Apache-2.0
// A part of a model.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns the Gaussians of `rows`, in that order, without the optimizer's state. Those with a residual come first.
Gaussians selected_rows(const Gaussians& gaussians, const std::vector<std::int64_t>& rows);

}  // namespace gs
