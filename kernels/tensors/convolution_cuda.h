// SPDX-License-Identifier: Apache-2.0
// A convolution on the device. Included by .cu files only.
#pragma once

#include "kernels/tensors/tensor_engine.h"

namespace gs {

/// `out` = the layer applied to `in`, then max(0, .) where `relu`; all on the device, sizes checked by the caller. On the default stream.
void launch_convolution(const Tensor& in, const ConvLayer& layer, bool relu, const Tensor& out);

}  // namespace gs
