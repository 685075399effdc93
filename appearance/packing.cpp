// SPDX-License-Identifier: Apache-2.0
// Checks and activations that the packings of all models share, and where each packing is found.
#include "appearance/packing.h"

#include <cmath>
#include <map>
#include <string>

#include "appearance/expression.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"

namespace gs {

namespace {

constexpr double kMaxTextures = 16, kMaxWeights = 1 << 24;

/// The fields of the header by their names in docs/formats.md, then the values that the description adds.
std::map<std::string, double> header_values(const PackingDescription& description, const PackedHeader& header) {
    std::map<std::string, double> values = {{"featureDim", header.features},
                                            {"nFrequencies", header.frequencies},
                                            {"shBandMask", header.bands},
                                            {"nNeurons", header.neurons},
                                            {"nHiddenLayers", header.hidden_layers},
                                            {"constantInput", header.constant_input},
                                            {"folded", header.folded}};
    for (const auto& [name, expression] : description.values) values[name] = evaluate_expression(expression, values);
    return values;
}

}  // namespace

PackedLayout packed_layout(const PackedHeader& header) {
    const PackingDescription& description = packing_description(header.model);
    const auto values = header_values(description, header);
    for (const auto& [field, condition, expected] : description.require) {
        if (evaluate_expression(condition, values) == 0)
            throw DataError(field + " is " + std::to_string(std::uint32_t(values.at(field))) + ", expected " +
                            expected);
    }
    PackedLayout layout;
    const auto size = [&](const std::string& expression, double largest) {
        const double value = evaluate_expression(expression, values);
        if (!(value >= 0 && value <= largest && value == std::floor(value)))
            throw DataError("the header asks for " + std::to_string(value) + " as '" + expression +
                            "', which is not a whole number up to " + std::to_string(std::int64_t(largest)));
        return std::int64_t(value);
    };
    const auto add = [&](std::int64_t count, int words) {
        layout.texture_words.insert(layout.texture_words.end(), std::size_t(count), words);
    };
    for (const auto& [words, count] : description.textures) add(size(count, kMaxTextures), words);
    add((size(description.halves, kMaxHalves) + kHalvesPerTexel - 1) / kHalvesPerTexel, 4);
    layout.weight_halves = size(description.weight_halves, kMaxWeights);
    return layout;
}

PackedAppearance make_packed(const PackedHeader& header, const Gaussians& gaussians) {
    const PackedLayout layout = packed_layout(header);
    // Without textures the residuals are not stored, whatever the model has.
    const std::int64_t rows = layout.texture_words.empty() ? 0 : gaussians.num_rows(Group::kResidual);
    PackedAppearance packed{header, std::vector<std::uint16_t>(std::size_t(layout.weight_halves)), rows, {}};
    for (const int words : layout.texture_words) packed.textures.emplace_back(std::size_t(rows * words));
    return packed;
}

Vec3<double> packed_residual(const Packing& packing, const PackedAppearance& packed, std::int64_t row,
                             const Vec3<double>& direction) {
    return row < packed.rows ? packing.residual(packed, row, direction) : Vec3<double>{0, 0, 0};
}

Vec3<double> packed_activation(PackedResidualActivation kind, const Vec3<double>& x) {
    const auto each = [&](double v) {
        switch (kind) {
            case PackedResidualActivation::kNone:
                return v;
            case PackedResidualActivation::kTanh:
                return gs_tanh(v);
            case PackedResidualActivation::kSoftplus:
                return softplus(10 * v) / 10;
        }
        return v;
    };
    return {each(x.x), each(x.y), each(x.z)};
}

const Packing& packing_of(std::uint32_t model) {
    for (const ModelInfo* info : appearance_models()) {
        if (info->packing && info->packing->description->id == model) return *info->packing;
    }
    throw DataError("no appearance model of this program has the number " + std::to_string(model));
}

}  // namespace gs
