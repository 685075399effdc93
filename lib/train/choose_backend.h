// SPDX-License-Identifier: Apache-2.0
// Chooses the device that trains a model and the device that scores it.
#pragma once

#include "kernels/ranks/backend.h"
#include "kernels/tensors/tensor_engine.h"
#include "lib/core/train_options.h"

namespace gs {

/// Returns whether `device` selects the GPU on this machine; kAuto selects it if a usable GPU exists.
bool uses_cuda(Device device);

/// Tests the GPU that `device` selects by running one kernel on it (try_cuda_device), before anything else uses it. If
/// that fails, throws DeviceError for kCuda; for kAuto warns once that the CPU is used despite a GPU, and why.
void try_device(Device device);

/// Returns the engine options that follow from a run's options.
EngineOptions engine_options(const TrainOptions& options);

/// Makes the engine of this process. Throws DeviceError for kCuda without a device, UsageError for GPU-only options on
/// the CPU.
std::unique_ptr<Engine> make_engine(Device device, const AppearanceSpec& appearance, const EngineOptions& options);

/// Logs the device of a backend, and the reason if kAuto found no GPU.
void log_device(Device device, const Backend& backend);

/// Makes the engine that computes learned metrics. Throws DeviceError for kCuda without a usable device.
std::unique_ptr<TensorEngine> choose_tensor_engine(Device device);

}  // namespace gs
