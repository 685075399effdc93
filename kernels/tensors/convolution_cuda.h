// SPDX-License-Identifier: Apache-2.0
// A convolution on the device. Only .cu files include this header.
#pragma once

#include "kernels/tensors/tensor_engine.h"

namespace gs {

/// Applies the layer to `in`, then max(0, .) if `relu`, and writes `out`. Works on the default stream. All tensors must
/// be on the device, and the caller must have checked their sizes.
void launch_convolution(const Tensor& in, const ConvLayer& layer, bool relu, const Tensor& out);

}  // namespace gs
