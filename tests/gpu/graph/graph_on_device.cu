// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/graph/graph_on_device.h"

#include "kernels/cuda/device_memory.h"
#include "kernels/cuda/device_stream_cuda.h"

namespace gs::test {
namespace {

__global__ void append_digit(long long* number, int digit) { *number = 10 * *number + digit; }

}  // namespace

struct NumberOnDevice::State {
    DeviceBuffer<long long> number;
    LaunchGraph graph;
    cudaStream_t stream = nullptr;
};

NumberOnDevice::NumberOnDevice() : state_(std::make_unique<State>()) {
    GS_CUDA(cudaStreamCreate(&state_->stream));
    GS_CUDA(cudaMemset(state_->number.reserve(1), 0, sizeof(long long)));
}
NumberOnDevice::~NumberOnDevice() { cudaStreamDestroy(state_->stream); }

void NumberOnDevice::append_together(const std::vector<int>& digits, const std::function<void()>& then) {
    state_->graph.run(state_->stream, [&] {
        for (const int digit : digits) append(digit);
        then();
    });
}
void NumberOnDevice::append(int digit) {
    append_digit<<<1, 1, 0, state_->stream>>>(state_->number.get(), digit);
    GS_CUDA_LAUNCHED("append_digit");
}
long long NumberOnDevice::read() {
    GS_CUDA(cudaStreamSynchronize(state_->stream));
    return state_->number.download(1)[0];
}

}  // namespace gs::test
