// SPDX-License-Identifier: Apache-2.0
// Argument checks common to all engines, and the shapes of their results.
#pragma once

#include "kernels/tensors/tensor_engine.h"

namespace gs {

/// Returns a tensor without values, with one pixel for each window in `in`. Throws UsageError if no window fits.
Tensor shape_of_windows(const Tensor& in, int channels, int kernel, int stride, int padding);

/// Returns the shape of a layer's result. Throws UsageError if no window fits, or if channels, weights or biases do not
/// match.
Tensor shape_of_convolution(const Tensor& in, const ConvLayer& layer);

/// Returns the shape of the stacked parts. Throws UsageError if their sizes differ.
Tensor shape_of_stack(std::initializer_list<Tensor> parts);

/// Throws UsageError unless the tensor has this shape.
void require_shape(const Tensor& tensor, int channels, int height, int width);

}  // namespace gs
