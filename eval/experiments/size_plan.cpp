// SPDX-License-Identifier: Apache-2.0
// Takes the size of a file apart.
#include "eval/experiments/size_plan.h"

#include <fmt/format.h>

#include <cmath>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/bytes.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/ply.h"
#include "lib/train/residual_share.h"

namespace gs {
namespace {

/// The bytes kept for texts whose length is known only later: the trailer of a scene, the header of a PLY.
constexpr std::int64_t kTrailerBytes = 1024, kPlyHeaderBytes = 4096;
/// The bytes of a Gaussian in a .splat file.
constexpr std::int64_t kSplatBytes = 32;

/// Packs a model of one Gaussian, with as many cameras as the scene's export has.
PackedScene packed_sample(const TrainOptions& options, const Scene& scene) {
    PackedScene packed = packed_sample(appearance_spec(options));
    packed.cameras.resize(scene.test.size());
    if (options.ppisp != PpispMode::kOff) packed.ppisp.emplace().views.resize(scene.test.size());
    return packed;
}

}  // namespace

std::int64_t SizePlan::bytes(std::int64_t count) const {
    const auto padded = [&](std::int64_t n) { return (n + unit - 1) / unit * unit; };
    const std::int64_t header = share < 1 && per_residual > 0 ? sizeof(std::uint32_t) : 0;  // the number of residuals
    return fixed + header + padded(count) * per_gaussian + padded(std::llround(share * double(count))) * per_residual;
}

SizePlan plan_size(const TrainOptions& options, const Scene& scene) {
    SizePlan plan{.limit = std::int64_t(parse_bytes(options.size_limit))};
    const AppearanceSpec appearance = appearance_spec(options);
    switch (options.size_of) {
        case SizeOf::kWeb: {
            const PackedScene sample = packed_sample(options, scene);
            plan.fixed = ngsplat_bytes(sample, 0, kTrailerBytes);
            plan.unit = ngsplat_unit();
            plan.per_gaussian = sample.bytes_per_gaussian(false);
            plan.per_residual = sample.bytes_per_gaussian() - plan.per_gaussian;
            plan.share = wanted_residual_share(options, appearance).value_or(kMostAutoShare);
            break;
        }
        case SizeOf::kPly:
            plan.fixed = kPlyHeaderBytes + std::int64_t(sizeof(float)) * appearance_model(appearance.model).num_shared;
            plan.per_gaussian = ply_bytes_per_gaussian(appearance);
            break;
        case SizeOf::kSplat:
            plan.per_gaussian = kSplatBytes;
    }
    if (plan.limit < plan.bytes(1))
        throw UsageError(
            fmt::format("option size-limit: {} is too small: the smallest {} file of {} takes {} bytes here",
                        options.size_limit, word(options.size_of), options.appearance, plan.bytes(1)));
    const double most = double(plan.limit - plan.fixed) / plan.mean_bytes();
    plan.most_gaussians = (std::int64_t(most) / plan.unit + 1) * plan.unit;
    while (plan.most_gaussians > plan.unit && plan.bytes(plan.most_gaussians) > plan.limit)
        plan.most_gaussians -= plan.unit;
    return plan;
}

}  // namespace gs
