// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/sums/sums_on_device.h"

#include "kernels/cuda/device_memory.h"
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs::test {

std::vector<float> sum_on_device(const std::vector<float>& values, const std::vector<std::uint8_t>& is_set, int width) {
    DeviceBuffer<float> in, out;
    DeviceBuffer<std::uint8_t> set;
    in.upload(values), set.upload(is_set);
    sum_rows({in.get(), set.get()}, int(is_set.size()), width, out.reserve(width), nullptr);
    return out.download(width);
}

}  // namespace gs::test
