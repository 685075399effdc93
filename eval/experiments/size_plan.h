// SPDX-License-Identifier: Apache-2.0
// How many Gaussians fit into a file of limited size.
#pragma once

#include <cstdint>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct SizePlan {
    std::int64_t limit = 0;                    ///< bytes
    std::int64_t fixed = 0, per_gaussian = 0;  ///< bytes of the file
    std::int64_t per_residual = 0;             ///< bytes that a Gaussian with a residual takes besides
    double share = 1;                          ///< share of the Gaussians that have one
    std::int64_t unit = 1;                     ///< the file has room for multiples of this number
    std::int64_t most_gaussians = 0;           ///< the most that fit

    /// Returns the size of a file of `count` Gaussians, at most 4 KiB too much.
    std::int64_t bytes(std::int64_t count) const;
    /// Returns the mean size of a Gaussian in it.
    double mean_bytes() const { return double(per_gaussian) + share * double(per_residual); }
};

/// Returns the plan for options.size_limit, which must not be empty. Throws UsageError naming the smallest size if not
/// even one Gaussian fits.
SizePlan plan_size(const TrainOptions& options, const Scene& scene);

}  // namespace gs
