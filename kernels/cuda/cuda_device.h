// SPDX-License-Identifier: Apache-2.0
// The CUDA device: whether this build can use one on this machine, its description and its peak rates.
#pragma once

#include <string>

#include "kernels/base/ceilings.h"

namespace gs {

/// Returns whether this build has CUDA, this thread's device responds, and this build has code for it.
bool cuda_available();

/// Returns the number of devices that respond, including devices for which this build has no code; 0 without CUDA.
int cuda_device_count();

/// Runs one kernel on this thread's device. Returns why it did not run; empty if it ran. From then on
/// cuda_unavailable_reason() returns the same. A process tries its device once and keeps the CUDA context that this
/// creates.
std::string try_cuda_device();

/// Selects device `index` for this thread from now on. Throws DeviceError.
void use_cuda_device(int index);

/// Returns a text that identifies this thread's device uniquely, on any machine; empty if cuda_available() is false.
std::string cuda_device_id();

/// Returns in one line why cuda_available() is false: "built without CUDA", the driver's message, or the GPU, the
/// architectures of this build and the command that builds for the GPU. Creates no CUDA context.
std::string cuda_unavailable_reason();

/// Returns the architectures for which this build contains code, e.g. "sm_80 sm_90 sm_120+PTX"; empty for a build
/// without CUDA.
std::string cuda_architectures();

/// Returns the device, its memory, and the CUDA versions of driver and runtime in one line. Throws DeviceError if
/// cuda_available() is false.
std::string cuda_driver_description();

/// Measures the current device by a copy of 1 GiB (or a quarter of the free memory, if that is less) and by independent
/// chains of FMAs, best of five each. Allocates and frees memory, and waits for the device. Throws DeviceError.
Ceilings cuda_ceilings();

}  // namespace gs
