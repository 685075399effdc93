// SPDX-License-Identifier: Apache-2.0
// Logs the memory that a run will need before it starts, and describes the memory that it took.
#pragma once

#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Logs the memory of the images against their budget, of the model at its start and at the cap, and of one view. Warns
/// when the sum exceeds the machine's memory.
void log_memory_plan(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance,
                     std::int64_t num_gaussians);

/// Returns one line: peak and present bytes of the device, and each row with its bytes per item.
std::string memory_report(const MemoryUse& memory);

}  // namespace gs
