// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/out_of_memory/device_hog.h"

#include "kernels/cuda/cuda.h"

namespace gs::test {

std::size_t DeviceHog::free_bytes() {
    std::size_t free = 0, total = 0;
    GS_CUDA(cudaMemGetInfo(&free, &total));
    return free;
}

DeviceHog::DeviceHog(std::size_t left) {
    // One large piece may not be there in one place: halves until nothing above the rest is free.
    for (std::size_t piece = free_bytes(); piece >= std::size_t(8) << 20; piece /= 2) {
        while (free_bytes() >= left + piece) {
            void* p = nullptr;
            if (cudaMalloc(&p, piece) != cudaSuccess) {
                cudaGetLastError();
                break;
            }
            pieces_.push_back(p);
        }
    }
}

void DeviceHog::release() {
    for (void* p : pieces_) cudaFree(p);
    pieces_.clear();
}

}  // namespace gs::test
