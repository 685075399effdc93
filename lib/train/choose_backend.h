// SPDX-License-Identifier: Apache-2.0
// Chooses the device for a model and for its scores.
#pragma once

#include <string>

#include "kernels/backend.h"
#include "kernels/tensors/tensor_engine.h"
#include "lib/core/train_options.h"

namespace gs {

/// Returns true if `device` ("cpu", "cuda", or "auto": CUDA if there is a device) means the GPU on this machine.
bool uses_cuda(const std::string& device);

/// Returns the part of a run's options that concerns the backend.
BackendOptions backend_options(const TrainOptions& options);

/// Makes the backend. Throws DeviceError for "cuda" without a device, UsageError for GPU-only options on the CPU.
std::unique_ptr<Backend> make_backend(const std::string& device, const AppearanceSpec& appearance, const BackendOptions& options);

/// Makes the backend as above and logs its device; for an "auto" that found no GPU also the reason.
std::unique_ptr<Backend> choose_backend(const std::string& device, const AppearanceSpec& appearance, const BackendOptions& options);

/// Makes the engine on which learned metrics compute. Throws DeviceError as make_backend does.
std::unique_ptr<TensorEngine> choose_tensor_engine(const std::string& device);

}  // namespace gs
