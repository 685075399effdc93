// SPDX-License-Identifier: Apache-2.0
// A model whose rows several ranks hold: rank 0's backend, and what the others do.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "kernels/ranks/backend.h"
#include "kernels/ranks/message.h"
#include "lib/core/train_options.h"
#include "lib/group/rank_team.h"
#include "lib/io/image.h"

namespace gs {

/// Returns how many ranks to start on this machine: options.ranks, or without a number as many as it has GPUs, which is
/// 1 where torchrun or Slurm started them. Throws UsageError for `device: cpu`, DeviceError where there is no GPU.
int num_local_ranks(const TrainOptions& options);

/// Gives each rank of a machine a GPU of its own, where `device` is one. Does nothing where there is none. Throws
/// UsageError where there are too few.
void choose_device(const RankTeam& team, Device device);

/// Connects the GPUs of all ranks, where `device` is one, so that splats go from one to another. Rank 0 says where they
/// cannot. All ranks must call it after choose_device, at the same point of what they say to each other.
void connect_devices(RankTeam& team, Device device);

/// Makes the backend of rank 0, and logs its device if a training `is_announced`. The other ranks of `team`, which must
/// be in follow_backends, make their engines; null: there are none. Steps take up to `views_per_step` views;
/// `about_targets` is for the function by which the others bring their photographs. The team must outlive the backend.
std::unique_ptr<Backend> make_sharded_backend(RankTeam* team, Device device, const AppearanceSpec& appearance,
                                              const EngineOptions& options, int views_per_step = 1,
                                              const MessageWriter& about_targets = {}, bool is_announced = false);

/// Makes what brings the photographs of a backend's steps, by what rank 0 says about them.
using TargetSourceMaker = std::function<TargetSource(MessageReader& about_targets)>;

/// Holds this rank's part of one such backend after another until rank 0 ends. To be called by RankTeam::follow.
void follow_backends(RankTeam& team, const TargetSourceMaker& make_targets);

/// Does the part of a rank other than 0 of a command that trains no scene: photographs come from rank 0 (put_targets).
/// `started_as` are the choices in which it must agree with rank 0 (RankTeam::agree). Throws DeviceError without a
/// message where rank 0 says it.
void follow_sharding(RankTeam& team, const std::string& started_as);

/// Writes photographs, 8-bit, by TargetImage::id, for the ranks in follow_sharding.
void put_targets(MessageWriter& message, const std::vector<Image>& targets);

/// Returns the choices in which the ranks of a command must agree: the build and the command's name.
std::string started_as(const std::string& command);

/// Returns the number of views of a step: `batch`, or without a number one for each rank. `team` is null for a process
/// alone.
int views_of_step(const std::optional<int>& batch, const RankTeam* team);

/// Returns the CPU threads of a rank that may use `wanted` (0: all that its machine has, shared out).
int threads_of_rank(const RankTeam& team, int wanted);

}  // namespace gs
