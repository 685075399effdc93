// SPDX-License-Identifier: Apache-2.0
// Whether this build and this machine can use CUDA, and what the device reaches.
#pragma once

#include <string>

#include "kernels/core/ceilings.h"

namespace gs {

/// Compiled in, and a device answers.
bool cuda_available();

/// How many answer; 0 where cuda_available() is false.
int cuda_device_count();

/// One line saying why cuda_available() is false ("built without CUDA", the driver's message).
std::string cuda_unavailable_reason();

/// The architectures this build holds code for, e.g. "sm_80 sm_90 sm_120+PTX"; empty for a build without CUDA.
std::string cuda_architectures();

/// Device, its memory, and the CUDA versions of driver and runtime, in one line. Throws DeviceError where cuda_available()
/// is false.
std::string cuda_driver_description();

/// Of the current device: a copy of 1 GiB (or a quarter of the free memory, if that is less) and independent chains of FMAs,
/// best of five each. Allocates and frees; waits for the device. Throws DeviceError.
Ceilings cuda_ceilings();

}  // namespace gs
