// SPDX-License-Identifier: Apache-2.0
// What a run will need in memory, said before it starts, and what it took.
#pragma once

#include <string>

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Logs images against their budget, the model at its start and at the cap, and what a view takes; warns when the sum
/// exceeds the machine's memory.
void log_memory_plan(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance, std::int64_t num_gaussians);

/// One line: peak and present bytes of the device, and each row with its bytes per item.
std::string memory_report(const MemoryUse& memory);

}  // namespace gs
