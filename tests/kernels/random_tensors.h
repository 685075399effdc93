// SPDX-License-Identifier: Apache-2.0
// Seeded tensors of values in [-1,1] on any engine.
#pragma once

#include "kernels/tensors/tensor_engine.h"
#include "tests/kernels/random_values.h"

namespace gs::test {

inline Tensor random_tensor(const TensorEngine& engine, int channels, int height, int width, std::uint64_t seed) {
    return engine.upload(channels, height, width, random_values(std::size_t(channels) * height * width, seed, -1, 1));
}

/// Fills in random weights and biases of a layer whose sizes are given.
inline ConvLayer random_layer(const TensorEngine& engine, ConvLayer layer, std::uint64_t seed) {
    layer.weights = random_tensor(engine, layer.out, layer.in, layer.kernel * layer.kernel, seed);
    layer.bias = random_tensor(engine, layer.out, 1, 1, seed + 1);
    return layer;
}

}  // namespace gs::test
