// SPDX-License-Identifier: Apache-2.0
// Determines the iterations after which the options request files, previews or scores.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

/// Returns whether `iterations`, the list of an option, contains `iteration`.
inline bool lists(const std::vector<std::int64_t>& iterations, std::int64_t iteration) {
    return std::find(iterations.begin(), iterations.end(), iteration) != iterations.end();
}

inline bool preview_is_due(const OutputOptions& options, std::int64_t iteration) {
    return options.preview_every && iteration % *options.preview_every == 0;
}

/// Returns whether anything is written or scored after this iteration.
inline bool output_is_due(const OutputOptions& options, std::int64_t iteration) {
    return preview_is_due(options, iteration) || lists(options.checkpoint_iterations, iteration) ||
           lists(options.save_iterations, iteration) || lists(options.test_iterations, iteration);
}

/// Returns the first iteration after `iteration` for which output_is_due() holds; the largest integer if there is none.
inline std::int64_t next_output(const OutputOptions& options, std::int64_t iteration) {
    std::int64_t next = std::numeric_limits<std::int64_t>::max();
    if (options.preview_every) next = (iteration / *options.preview_every + 1) * *options.preview_every;
    for (const auto* list : {&options.test_iterations, &options.save_iterations, &options.checkpoint_iterations})
        for (const std::int64_t listed : *list)
            if (listed > iteration) next = std::min(next, listed);
    return next;
}

}  // namespace gs
