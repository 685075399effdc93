// SPDX-License-Identifier: Apache-2.0
// Reads and checks the weights of learned metrics.
#include "eval/metrics/metric_weights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"

namespace gs {

std::vector<float> MetricWeights::read(const std::string& name, const std::vector<std::int64_t>& shape) const {
    const auto& stored = file_.tensor(name).shape;
    if (stored != shape)
        throw DataError(fmt::format("{}: tensor '{}' has shape ({}), expected ({})", path_.string(), name,
                                    fmt::join(stored, ","), fmt::join(shape, ",")));
    std::vector<float> values = file_.read<float>(name);
    const auto bad = std::find_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); });
    if (bad != values.end())
        throw DataError(
            fmt::format("{}: tensor '{}' holds {} at index {}", path_.string(), name, *bad, bad - values.begin()));
    return values;
}

ConvLayer MetricWeights::read_layer(const TensorEngine& engine, const std::string& name, ConvLayer layer) const {
    layer.weights = engine.upload(layer.out, layer.in, layer.kernel * layer.kernel,
                                  read(name + ".weight", {layer.out, layer.in, layer.kernel, layer.kernel}));
    layer.bias = engine.upload(layer.out, 1, 1, read(name + ".bias", {layer.out}));
    return layer;
}

}  // namespace gs
