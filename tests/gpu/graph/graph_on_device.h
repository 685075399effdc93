// SPDX-License-Identifier: Apache-2.0
// kernels/cuda/device_stream_cuda.h for host code.
#pragma once

#include <functional>
#include <memory>
#include <vector>

namespace gs::test {

/// A number on the device, and a graph of kernels that change it.
class NumberOnDevice {
  public:
    NumberOnDevice();
    ~NumberOnDevice();
    /// Sets the number to 10 times itself plus each of `digits` in turn, by a kernel each, and then calls `then`, all
    /// within one LaunchGraph::run().
    void append_together(
        const std::vector<int>& digits, const std::function<void()>& then = [] {});
    /// Does the same for one digit, in the stream.
    void append(int digit);
    /// Waits for the device and returns the number.
    long long read();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace gs::test
