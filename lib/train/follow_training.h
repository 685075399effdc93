// SPDX-License-Identifier: Apache-2.0
// The agreement of a training's ranks on build and options, and the part of the ranks other than 0.
#pragma once

#include "lib/core/train_options.h"
#include "lib/group/rank_group.h"
#include "lib/scene/scene.h"
#include "lib/train/group_backend.h"

namespace gs {

/// Checks that all ranks have the same build and the same options (RankGroup::agree). Throws UsageError.
void agree_on_options(RankGroup& group, const TrainOptions& options);

/// Returns the views of a training's steps (options.batch), for make_backend. `group` may be null; its other ranks read
/// the images of `scene` that they render.
StepViews step_views(const TrainOptions& options, const Scene& scene, const RankGroup* group);

/// Takes part in one training after another as a rank other than 0, until rank 0 ends. Throws DataError naming a
/// missing file or view, UsageError naming the option that differs from rank 0's, and DeviceError without a message if
/// rank 0 reports the error.
void follow_training(RankGroup& group, TrainOptions options);

}  // namespace gs
