// SPDX-License-Identifier: Apache-2.0
// A model whose rows several ranks hold, for commands that render and measure it instead of training a scene.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "kernels/ranks/ranked_backend.h"
#include "lib/core/train_options.h"
#include "lib/io/image.h"
#include "lib/ranks/rank_team.h"

namespace gs {

/// Returns how many ranks to start on this machine: options.ranks, or for kAllGpus as many as it has GPUs, which is 1
/// where torchrun or Slurm started them. Throws UsageError for `device: cpu`, DeviceError where there is no GPU.
int num_local_ranks(const TrainOptions& options);

/// Gives each rank of a machine a GPU of its own, where `device` is one. Does nothing where there is none. Throws
/// UsageError where there are too few.
void choose_device(const RankTeam& team, Device device);

/// Connects the GPUs of all ranks, where `device` is one, so that splats go from one to another. Rank 0 says where they
/// cannot. All ranks must call it after choose_device, at the same point of what they say to each other.
void connect_devices(RankTeam& team, Device device);

/// Makes the backend of rank 0. The other ranks of `team`, which must be in follow_sharding, make theirs; null: there
/// are none. Steps take up to `views_per_step` views; `targets`, 8-bit, are their photographs by TargetImage::id. The
/// team must outlive the backend.
std::unique_ptr<RankedBackend> make_sharded_backend(RankTeam* team, Device device, const AppearanceSpec& appearance,
                                                    const BackendOptions& options, int views_per_step = 1,
                                                    const std::vector<Image>& targets = {});

/// Does the part of a rank other than 0 for one such backend after another until rank 0 ends. `started_as` are the
/// choices in which it must agree with rank 0 (RankTeam::agree). Throws DeviceError without a message where rank 0
/// says it.
void follow_sharding(RankTeam& team, const std::string& started_as);

/// Returns the choices in which the ranks of a command must agree: the build and the command's name.
std::string started_as(const std::string& command);

/// Returns the number of views of a step: `batch`, or for 0 one for each rank. `team` is null for a process alone.
int views_of_step(int batch, const RankTeam* team);

/// Returns the CPU threads of a rank that may use `wanted` (0: all that its machine has, shared out).
int threads_of_rank(const RankTeam& team, int wanted);

}  // namespace gs
