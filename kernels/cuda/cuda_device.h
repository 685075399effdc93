// SPDX-License-Identifier: Apache-2.0
// The CUDA device: whether this build and this machine can use one, its description and its peak rates.
#pragma once

#include <string>

#include "kernels/base/ceilings.h"

namespace gs {

/// Returns whether this build has CUDA, this thread's device answers and this build has code for it.
bool cuda_available();

/// Returns the number of devices that answer, including those that this build has no code for; 0 without CUDA.
int cuda_device_count();

/// Runs one kernel on this thread's device. Returns why it did not run, as cuda_unavailable_reason() does from then on;
/// empty if it ran. A process tries its device once and keeps the CUDA context that this makes.
std::string try_cuda_device();

/// Makes device `index` that of this thread, for all that it does from now on. Throws DeviceError.
void use_cuda_device(int index);

/// Returns a text that tells this thread's device from all others, on any machine; empty if cuda_available() is
/// false.
std::string cuda_device_id();

/// Returns in one line why cuda_available() is false: "built without CUDA", the driver's message, or the GPU, what this
/// build has code for and the command that builds for the GPU. Makes no CUDA context.
std::string cuda_unavailable_reason();

/// Returns the architectures that this build holds code for, e.g. "sm_80 sm_90 sm_120+PTX"; empty for a build without
/// CUDA.
std::string cuda_architectures();

/// Returns the device, its memory, and the CUDA versions of driver and runtime in one line. Throws DeviceError where
/// cuda_available() is false.
std::string cuda_driver_description();

/// Measures the current device by a copy of 1 GiB (or a quarter of the free memory, if that is less) and by independent
/// chains of FMAs, best of five each. Allocates and frees memory, and waits for the device. Throws DeviceError.
Ceilings cuda_ceilings();

}  // namespace gs
