// SPDX-License-Identifier: Apache-2.0
// Checks shapes. Each error names the operation.
#include "kernels/tensors/tensor_checks.h"

#include <string>

#include "kernels/base/error.h"

namespace gs {
namespace {

std::string shape_text(int channels, int height, int width) {
    return "(" + std::to_string(channels) + "," + std::to_string(height) + "," + std::to_string(width) + ")";
}

int output_side(int n, int kernel, int stride, int padding) {
    return n + 2 * padding < kernel ? 0 : (n + 2 * padding - kernel) / stride + 1;
}

}  // namespace

Tensor shape_of_windows(const Tensor& in, int channels, int kernel, int stride, int padding) {
    const int height = output_side(in.height, kernel, stride, padding),
              width = output_side(in.width, kernel, stride, padding);
    if (height == 0 || width == 0)
        throw UsageError(std::to_string(in.width) + "x" + std::to_string(in.height) +
                         " values are too few for a window of " + std::to_string(kernel));
    return {channels, height, width, nullptr};
}

Tensor shape_of_convolution(const Tensor& in, const ConvLayer& layer) {
    require_shape(in, layer.in, in.height, in.width);
    require_shape(layer.weights, layer.out, layer.in, layer.kernel * layer.kernel);
    require_shape(layer.bias, layer.out, 1, 1);
    return shape_of_windows(in, layer.out, layer.kernel, layer.stride, layer.padding);
}

Tensor shape_of_stack(std::initializer_list<Tensor> parts) {
    Tensor all{0, parts.begin()->height, parts.begin()->width, nullptr};
    for (const Tensor& part : parts) {
        require_shape(part, part.channels, all.height, all.width);
        all.channels += part.channels;
    }
    return all;
}

void require_shape(const Tensor& tensor, int channels, int height, int width) {
    if (tensor.channels != channels || tensor.height != height || tensor.width != width)
        throw UsageError("a tensor has the shape " + shape_text(tensor.channels, tensor.height, tensor.width) +
                         " instead of " + shape_text(channels, height, width));
}

}  // namespace gs
