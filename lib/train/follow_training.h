// SPDX-License-Identifier: Apache-2.0
// What the ranks of a training agree on, and what those other than 0 do in it.
#pragma once

#include "lib/core/train_options.h"
#include "lib/group/rank_group.h"
#include "lib/scene/scene.h"
#include "lib/train/group_backend.h"

namespace gs {

/// Makes sure that all ranks have the same build and the same options (RankGroup::agree).
void agree_on_options(RankGroup& group, const TrainOptions& options);

/// Returns the views of a training's steps (options.batch), for make_backend. The other ranks of `group`, which may be
/// null, read the images of `scene` that they render.
StepViews step_views(const TrainOptions& options, const Scene& scene, const RankGroup* group);

/// Follows one training after another as a rank other than 0, until rank 0 ends. Throws DataError naming a missing file
/// or view, UsageError naming the option that differs from rank 0's, and DeviceError without a message if rank 0
/// reports the error.
void follow_training(RankGroup& group, TrainOptions options);

}  // namespace gs
