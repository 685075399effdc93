// SPDX-License-Identifier: Apache-2.0
// What all engines refuse, and the shapes of what they return.
#pragma once

#include "kernels/tensors/tensor_engine.h"

namespace gs {

/// A tensor of the size that a window leaves of `in`, without values. Throws UsageError where no window fits.
Tensor shape_of_windows(const Tensor& in, int channels, int kernel, int stride, int padding);

/// The same for a layer. Throws UsageError also where its channels, weights or biases do not fit.
Tensor shape_of_convolution(const Tensor& in, const ConvLayer& layer);

/// Throws UsageError for parts of different sizes.
Tensor shape_of_stack(std::initializer_list<Tensor> parts);

/// Throws UsageError unless the tensor has this shape.
void require_shape(const Tensor& tensor, int channels, int height, int width);

}  // namespace gs
