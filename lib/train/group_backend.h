// SPDX-License-Identifier: Apache-2.0
// Makes the backend of a single process or of a group of ranks, and runs the other ranks' part.
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

/// Returns the number of ranks to start on this machine: options.ranks, or if that is empty one for each GPU (1 if
/// torchrun or Slurm started the ranks). If it is empty, throws UsageError for `device: cpu` and DeviceError without a
/// GPU.
int num_local_ranks(const TrainOptions& options);

/// Assigns each rank of a machine its own GPU, if `device` selects the GPU. Does nothing without a GPU. Throws
/// UsageError if there are fewer GPUs than ranks.
void choose_device(const RankGroup& group, Device device);

/// Connects the GPUs of all ranks so that splats pass directly between them, unless `device` is kCpu. Rank 0 logs a
/// warning if they cannot. All ranks must call it after choose_device, at the same point of their communication.
void connect_devices(RankGroup& group, Device device);

/// The views of a backend's steps: their number per step, and the message from which the other ranks load their
/// photographs.
struct StepViews {
    int per_step = 1;
    MessageWriter about_targets = {};
};

/// Makes the backend of this process alone if `group` is null, else that of rank 0. The other ranks of `group` must be
/// in follow_backends, where they make their engines. The group must outlive the backend. Throws as make_engine does.
std::unique_ptr<Backend> make_backend(Device device, const AppearanceSpec& appearance, const EngineOptions& options,
                                      RankGroup* group = nullptr, const StepViews& views = {});

/// Makes the source of the photographs of a backend's steps from rank 0's message about them.
using TargetSourceMaker = std::function<TargetSource(MessageReader& about_targets)>;

/// Runs this rank's part of one backend after another until rank 0 ends. To be called by RankGroup::follow.
void follow_backends(RankGroup& group, const TargetSourceMaker& make_targets);

/// Takes part, as a rank other than 0, in a command that trains no scene. Photographs come from rank 0 (put_targets).
/// `started_as` must equal rank 0's (RankGroup::agree). Throws DeviceError without a message if rank 0 reports the
/// error.
void follow_command(RankGroup& group, const std::string& started_as);

/// Writes 8-bit photographs, indexed by TargetImage::id, for the ranks in follow_command.
void put_targets(MessageWriter& message, const std::vector<Image>& targets);

/// Returns the settings on which the ranks of a command must agree: the build and the command's name.
std::string started_as(const std::string& command);

/// Returns the number of views of a step: `batch`, or if that is empty one for each rank, at most kLogInterval. `group`
/// is null for a single process.
int views_of_step(const std::optional<int>& batch, const RankGroup* group);

/// Returns the number of CPU threads of a rank: `wanted`, or for 0 its share of all threads of its machine.
int threads_of_rank(const RankGroup& group, int wanted);

}  // namespace gs
