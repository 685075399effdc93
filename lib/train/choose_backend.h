// SPDX-License-Identifier: Apache-2.0
// Which device a model runs on, and its scores are computed on.
#pragma once


#include "kernels/backend.h"
#include "kernels/tensors/tensor_engine.h"
#include "lib/core/train_options.h"

namespace gs {

/// Whether `device` means the GPU on this machine.
bool uses_cuda(Device device);

/// What the options of a run say about its backend.
BackendOptions backend_options(const TrainOptions& options);

/// Throws DeviceError for kCuda without a device, UsageError for options of the GPU on the CPU.
std::unique_ptr<Backend> make_backend(Device device, const AppearanceSpec& appearance, const BackendOptions& options);

/// The same, and one line of the log says which; of a kAuto that found no GPU, also why.
std::unique_ptr<Backend> choose_backend(Device device, const AppearanceSpec& appearance, const BackendOptions& options);

/// What learned metrics compute on. Throws as above.
std::unique_ptr<TensorEngine> choose_tensor_engine(Device device);

}  // namespace gs
