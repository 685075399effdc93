// SPDX-License-Identifier: Apache-2.0
#include "kernels/cuda_device.h"

#include <cuda_runtime.h>

namespace gs {

std::string cuda_unavailable_reason() {
    int count = 0;
    const cudaError_t error = cudaGetDeviceCount(&count);
    if (error != cudaSuccess) return cudaGetErrorString(error);
    return count > 0 ? "" : "no device";
}

bool cuda_available() { return cuda_unavailable_reason().empty(); }

}  // namespace gs
