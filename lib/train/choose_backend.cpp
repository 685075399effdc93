// SPDX-License-Identifier: Apache-2.0
// Chooses the device that trains a model and the device that scores it.
#include "lib/train/choose_backend.h"

#include <mutex>

#include "kernels/base/error.h"
#include "kernels/cuda/cuda_device.h"
#include "lib/core/log.h"
#include "lib/core/quantities.h"

namespace gs {

bool uses_cuda(Device device) { return device == Device::kCuda || (device == Device::kAuto && cuda_available()); }

void try_device(Device device) {
    if (device == Device::kCpu) return;
    const std::string failure = try_cuda_device();
    if (failure.empty()) return;
    if (device == Device::kCuda) throw DeviceError("option device: " + failure + "; or use --device cpu");
    static std::once_flag warned;
    if (cuda_device_count() > 0)
        std::call_once(warned, [&] { log_warning("the CPU is used, many times slower than the GPU: {}", failure); });
}

EngineOptions engine_options(const TrainOptions& options) {
    return {.deterministic = options.deterministic,
            .image_budget = std::int64_t(options.image_cache.count),
            .min_alpha = kMinAlpha * options.alpha_cutoff,
            .min_transmittance = options.transmittance_cutoff,
            .half_residuals = options.appearance_storage == AppearanceStorage::kFp16,
            .packed_moments = options.appearance_moments == AppearanceMoments::kBf16};
}

std::unique_ptr<Engine> make_engine(Device device, const AppearanceSpec& appearance, const EngineOptions& options) {
    try_device(device);
    const bool cuda = uses_cuda(device);
    if (!cuda && options.half_residuals)
        throw UsageError("option appearance-storage: fp16 needs a GPU; the CPU computes in fp32");
    return cuda ? make_cuda_engine(appearance, options) : make_cpu_engine(appearance, options);
}

void log_device(Device device, const Backend& backend) {
    // Adds the reason for a missing GPU; try_device has already warned about a GPU that cannot be used.
    const bool none = device == Device::kAuto && cuda_device_count() == 0;
    log_info("device: {}{}", backend.describe(), none ? " (" + cuda_unavailable_reason() + ")" : "");
}

std::unique_ptr<TensorEngine> choose_tensor_engine(Device device) {
    try_device(device);
    return uses_cuda(device) ? make_cuda_tensor_engine() : make_cpu_tensor_engine();
}

}  // namespace gs
