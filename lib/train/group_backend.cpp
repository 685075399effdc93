// SPDX-License-Identifier: Apache-2.0
// Sends the backend's settings to the other ranks, and follows rank 0 on them.
#include "lib/train/group_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <string_view>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/cuda/cuda_device.h"
#include "kernels/ranks/message.h"
#include "lib/core/log.h"
#include "lib/core/version.h"
#include "lib/train/choose_backend.h"
#include "lib/train/training_views.h"

namespace gs {
namespace {

/// Returns the value of an environment variable, empty if it is not set.
std::string_view variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}
bool may_share_gpus() { return !variable("GSAPP_SHARE_GPUS").empty() && variable("GSAPP_SHARE_GPUS") != "0"; }
/// Returns whether Slurm makes only its own GPUs visible to each task.
bool slurm_binds_gpus() {
    return !variable("SLURM_GPUS_PER_TASK").empty() || !variable("SLURM_GPU_BIND").empty() ||
           !variable("SLURM_TRES_PER_TASK").empty();
}

}  // namespace

int num_local_ranks(const TrainOptions& options) {
    if (options.ranks) return *options.ranks;
    if (options.device == Device::kCpu)
        throw UsageError("option ranks: all means one for each GPU, but the device is the CPU; name a number");
    if (rank_place([](const char* name) -> const char* { return std::getenv(name); })) return 1;
    if (const int count = cuda_device_count(); count > 0) return count;
    throw DeviceError("option ranks: all means one for each GPU, and there is none (" + cuda_unavailable_reason() +
                      ")");
}

void choose_device(const RankGroup& group, Device device) {
    const int count = uses_cuda(device) ? cuda_device_count() : 0;
    if (count == 0) return;  // make_backend reports the reason if a GPU was requested
    if (group.local_size() > count && !may_share_gpus() && !(count == 1 && slurm_binds_gpus()))
        throw UsageError(
            fmt::format("{} processes of this machine would share {} GPU{}; start as many as there are, "
                        "or set GSAPP_SHARE_GPUS=1 to try it",
                        group.local_size(), count, count == 1 ? "" : "s"));
    use_cuda_device(group.local_rank() % count);
}

void connect_devices(RankGroup& group, Device device) {
    if (device == Device::kCpu) return;
    const std::string why_not = group.connect_devices(cuda_device_id());
    if (group.rank() > 0) return;
    if (!why_not.empty()) log_warning("ranks: splats pass through the host's memory: {}", why_not);
    if (const DeviceLink* link = group.communicator().link())
        log_debug("ranks: splats go from GPU to GPU by {}", link->name());
}

std::unique_ptr<Backend> make_backend(Device device, const AppearanceSpec& appearance, const EngineOptions& options,
                                      RankGroup* group, const StepViews& views) {
    if (group) choose_device(*group, device);
    auto engine = make_engine(device, appearance, options);
    if (!group) return std::make_unique<Backend>(std::move(engine), nullptr, views.per_step);
    MessageWriter message;
    message.put(GroupCall::kHold).put(device);
    message.put(appearance.model).put(appearance.max_degree).put(appearance.activation).put(options);
    send_to_others(group->communicator(), message);
    send_to_others(group->communicator(), views.about_targets);
    connect_devices(*group, device);
    return std::make_unique<Backend>(std::move(engine), &group->communicator(), views.per_step);
}

void follow_backends(RankGroup& group, const TargetSourceMaker& make_targets) {
    while (true) {
        MessageReader message = receive_from_rank_0(group.communicator());
        if (message.get<GroupCall>() == GroupCall::kLeave) return;
        AppearanceSpec appearance;
        const auto device = message.get<Device>();
        message.get(appearance.model), message.get(appearance.max_degree), message.get(appearance.activation);
        const auto options = message.get<EngineOptions>();
        MessageReader about_targets = receive_from_rank_0(group.communicator());
        const TargetSource targets = make_targets(about_targets);
        choose_device(group, device);
        connect_devices(group, device);
        const auto engine = make_engine(device, appearance, options);
        follow(group.communicator(), *engine, targets);
    }
}

void put_targets(MessageWriter& message, const std::vector<Image>& targets) {
    message.put(std::uint64_t(targets.size()));
    for (const Image& image : targets) message.put(image.width).put(image.height).put(image.channels).put(image.u8);
}

void follow_command(RankGroup& group, const std::string& started_as) {
    group.follow([&] {
        group.agree(started_as);
        follow_backends(group, [](MessageReader& message) -> TargetSource {
            if (message.at_end()) return {};  // the command takes no steps
            std::vector<Image> images(message.get<std::uint64_t>());
            for (Image& image : images)
                message.get(image.width), message.get(image.height), message.get(image.channels), message.get(image.u8);
            return [images = std::move(images)](StepRequest& request) {
                const Image& image = images.at(std::size_t(request.target.id.view));
                TargetImage& target = request.target;
                target.width = image.width, target.height = image.height, target.channels = image.channels;
                target.u8 = image.u8.data();
            };
        });
    });
}

std::string started_as(const std::string& command) { return version_text() + "\ngsapp " + command + "\n"; }

int views_of_step(const std::optional<int>& batch, const RankGroup* group) {
    if (batch) return *batch;
    return group ? std::min(group->size(), int(kLogInterval)) : 1;  // steps end at multiples of kLogInterval
}

int threads_of_rank(const RankGroup& group, int wanted) {
    if (wanted > 0) return wanted;
    set_num_threads(0);
    return std::max(1, num_threads() / group.local_size());
}

}  // namespace gs
