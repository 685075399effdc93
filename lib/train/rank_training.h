// SPDX-License-Identifier: Apache-2.0
// Trains over several ranks: makes the backend of rank 0, and follows its training on the others.
#pragma once

#include <memory>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/group/rank_team.h"
#include "lib/scene/scene.h"

namespace gs {

/// Makes sure that all ranks have the same build and the same options (RankTeam::agree).
void agree_on_options(RankTeam& team, const TrainOptions& options);

/// Makes the backend of rank 0, which trains on options.batch views in a step. The other ranks, if there is a team,
/// hold their parts of the model and read the images of `scene` that they render. All references must outlive the
/// backend.
std::unique_ptr<Backend> make_ranked_backend(RankTeam* team, const TrainOptions& options, const Scene& scene,
                                             const AppearanceSpec& appearance, const EngineOptions& engine_options);

/// Does the part of a rank other than 0 in one training after another until rank 0 ends. Throws DataError naming file
/// or view, and UsageError naming the option in which it differs from rank 0; without a message where rank 0 prints it.
void follow_training(RankTeam& team, TrainOptions options);

}  // namespace gs
