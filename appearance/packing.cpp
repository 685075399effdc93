// SPDX-License-Identifier: Apache-2.0
// Checks and activations that the packings of all models share, and where each packing is found.
#include "appearance/packing.h"

#include <string>

#include "appearance/model_info.h"
#include "kernels/core/error.h"

namespace gs {

PackedAppearance make_packed(const PackedHeader& header, const PackedLayout& layout, std::int64_t count) {
    PackedAppearance packed{header, std::vector<std::uint16_t>(std::size_t(layout.weight_halves)), {}};
    for (const int words : layout.texture_words) packed.textures.emplace_back(std::size_t(count * words));
    return packed;
}

void require_packed(bool ok, const char* field, std::uint32_t value, const char* expected) {
    if (!ok) throw DataError(std::string(field) + " is " + std::to_string(value) + ", expected " + expected);
}

Vec3<double> packed_activation(PackedResidualActivation kind, const Vec3<double>& x) {
    const auto each = [&](double v) {
        switch (kind) {
            case PackedResidualActivation::kNone: return v;
            case PackedResidualActivation::kTanh: return gs_tanh(v);
            case PackedResidualActivation::kSoftplus: return softplus(10 * v) / 10;
        }
        return v;
    };
    return {each(x.x), each(x.y), each(x.z)};
}

const Packing& packing_of(PackedModel model) {
    for (const ModelInfo* info : appearance_models()) {
        if (info->packing && info->packing->model == model) return *info->packing;
    }
    throw DataError("no appearance model of this program has the number " + std::to_string(std::uint32_t(model)));
}

}  // namespace gs
