// SPDX-License-Identifier: Apache-2.0
// Weights of learned metrics, as scripts/export_metric_weights.py writes them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "kernels/tensors/tensor_engine.h"
#include "lib/io/safetensors.h"

namespace gs {

/// A file of float tensors whose names and shapes are known beforehand.
class MetricWeights {
  public:
    /// Opens the file. Throws DataError naming it when it cannot be read.
    explicit MetricWeights(const std::filesystem::path& path) : path_(path), file_(path) {}

    /// Returns the values of a tensor, row-major. Throws DataError naming file and tensor when the tensor is missing,
    /// has another shape or type, or holds a value that is not finite.
    std::vector<float> read(const std::string& name, const std::vector<std::int64_t>& shape) const;

    /// Loads `name`.weight and `name`.bias to `engine` for a layer whose sizes are filled in. Throws as read() does.
    ConvLayer read_layer(const TensorEngine& engine, const std::string& name, ConvLayer layer) const;

  private:
    std::filesystem::path path_;
    SafetensorsFile file_;
};

}  // namespace gs
