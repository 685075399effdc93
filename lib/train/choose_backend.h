// SPDX-License-Identifier: Apache-2.0
// Chooses the device for a model and for its scores.
#pragma once

#include "kernels/ranks/backend.h"
#include "kernels/tensors/tensor_engine.h"
#include "lib/core/train_options.h"

namespace gs {

/// Returns true if `device` means the GPU on this machine; with kAuto that is so if there is one that can be used.
bool uses_cuda(Device device);

/// Runs one kernel on the GPU that `device` means (try_cuda_device), before anything is built on it. Throws DeviceError
/// if that fails and `device` is kCuda; with kAuto warns once that the CPU is used although there is a GPU, and why.
void try_device(Device device);

/// Returns the part of a run's options that concerns the backend.
EngineOptions engine_options(const TrainOptions& options);

/// Makes the engine of this process. Throws DeviceError for kCuda without a device, UsageError for GPU-only options on
/// the CPU.
std::unique_ptr<Engine> make_engine(Device device, const AppearanceSpec& appearance, const EngineOptions& options);

/// Logs the device of a backend; for a kAuto that found no GPU also the reason.
void log_device(Device device, const Backend& backend);

/// Makes the engine on which learned metrics compute. Throws DeviceError as make_backend does.
std::unique_ptr<TensorEngine> choose_tensor_engine(Device device);

}  // namespace gs
