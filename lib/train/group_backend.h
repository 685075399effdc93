// SPDX-License-Identifier: Apache-2.0
// Makes the backend of a process alone or of a group of ranks, and lets the other ranks follow.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "kernels/ranks/backend.h"
#include "kernels/ranks/message.h"
#include "lib/core/train_options.h"
#include "lib/group/rank_group.h"
#include "lib/io/image.h"

namespace gs {

/// Returns how many ranks to start on this machine: options.ranks, or without a number as many as it has GPUs, which is
/// 1 if torchrun or Slurm started them. Throws UsageError for `device: cpu`, DeviceError if there is no GPU.
int num_local_ranks(const TrainOptions& options);

/// Gives each rank of a machine a GPU of its own, where `device` is one. Does nothing if there is none. Throws
/// UsageError if there are too few.
void choose_device(const RankGroup& group, Device device);

/// Connects the GPUs of all ranks, where `device` is one, so that splats go from one to another. Rank 0 says where they
/// cannot. All ranks must call it after choose_device, at the same point of what they say to each other.
void connect_devices(RankGroup& group, Device device);

/// The views of a backend's steps: how many a step takes, and what the function by which the other ranks bring their
/// photographs has to know.
struct StepViews {
    int per_step = 1;
    MessageWriter about_targets = {};
};

/// Makes a backend: of this process alone if `group` is null, else that of rank 0. The other ranks of `group` must be
/// in follow_backends, and make their engines. The group must outlive the backend. Throws as make_engine does.
std::unique_ptr<Backend> make_backend(Device device, const AppearanceSpec& appearance, const EngineOptions& options,
                                      RankGroup* group = nullptr, const StepViews& views = {});

/// Makes what brings the photographs of a backend's steps, by what rank 0 says about them.
using TargetSourceMaker = std::function<TargetSource(MessageReader& about_targets)>;

/// Holds this rank's part of one such backend after another until rank 0 ends. To be called by RankGroup::follow.
void follow_backends(RankGroup& group, const TargetSourceMaker& make_targets);

/// Follows a command that trains no scene as a rank other than 0; photographs come from rank 0 (put_targets).
/// `started_as` must equal rank 0's (RankGroup::agree). Throws DeviceError without a message if rank 0 reports it.
void follow_command(RankGroup& group, const std::string& started_as);

/// Writes photographs, 8-bit, by TargetImage::id, for the ranks in follow_command.
void put_targets(MessageWriter& message, const std::vector<Image>& targets);

/// Returns the choices in which the ranks of a command must agree: the build and the command's name.
std::string started_as(const std::string& command);

/// Returns the number of views of a step: `batch`, or without a number one for each rank. `group` is null for a process
/// alone.
int views_of_step(const std::optional<int>& batch, const RankGroup* group);

/// Returns the CPU threads of a rank that may use `wanted` (0: all that its machine has, shared out).
int threads_of_rank(const RankGroup& group, int wanted);

}  // namespace gs
