// SPDX-License-Identifier: Apache-2.0
// A splat as one rank of a training sends it to the rank that renders its view, and what ranks say to each other of the
// views of a step.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "kernels/base/portable.h"
#include "kernels/splat/projection_device.h"
#include "kernels/splat/splat_device.h"

namespace gs {

/// The row of a splat that only fills an array.
inline constexpr std::uint32_t kNowhere = 0xffffffff;

/// The places of the splats of 32 Gaussians in a row in a view: a bit for each Gaussian that has one, and the place of
/// the first. The others follow it.
struct SplatPlaces {
    std::uint32_t shown, first;

    GS_HD bool shows(unsigned k) const { return shown >> k & 1; }
#if defined(__CUDACC__)
    __device__ std::uint32_t place(unsigned k) const { return first + unsigned(__popc(shown & ((1u << k) - 1))); }
#endif
};

/// The largest side of an image in pixels whose splats can be sent.
inline constexpr int kMaxWireSide = 0xffff;

/// What sorting and blending need of a Gaussian in one view.
struct alignas(16) WireSplat {
    float mean_x, mean_y;                ///< pixels
    float a, b, c;                       ///< conic, as in Splat
    float opacity;                       ///< activated
    float red, green, blue;              ///< after the colour activation
    std::uint32_t x_min_max, y_min_max;  ///< the pixels that it may reach: first | end << 16
    float depth;                         ///< along the camera's axis, frame units

    static GS_HD WireSplat of(const Splat<float>& s, const PixelBounds& b, float depth) {
        const auto range = [](int first, int end) {
            return std::uint32_t(first) | std::uint32_t(gs_min(end, kMaxWireSide)) << 16;
        };
        return {s.mean.x,
                s.mean.y,
                s.a,
                s.b,
                s.c,
                s.opacity,
                s.color.x,
                s.color.y,
                s.color.z,
                range(b.x_min, b.x_max),
                range(b.y_min, b.y_max),
                depth};
    }
    GS_HD Splat<float> splat(float inverse_alpha) const {
        return {{mean_x, mean_y}, a, b, c, opacity, {red, green, blue}, splat_threshold(opacity, inverse_alpha)};
    }
    /// Returns the pixels that it may reach in an image padded to whole tiles, which differ between backends.
    GS_HD PixelBounds bounds(int width_padded, int height_padded) const {
        return {int(x_min_max & 0xffff), gs_min(int(x_min_max >> 16), width_padded), int(y_min_max & 0xffff),
                gs_min(int(y_min_max >> 16), height_padded)};
    }
};
static_assert(sizeof(WireSplat) == 48);

/// The loss of one view and its parts.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
};

/// Returns the loss of a view by the sums of its weighted differences and SSIM over pixels and channels.
GS_HD ViewLoss loss_of_sums(double l1, double ssim, float lambda_dssim, double weight_sum, std::int64_t num_instances) {
    const double norm = weight_sum > 0 ? 1 / (3 * weight_sum) : 0;
    l1 *= norm, ssim *= norm;
    return {norm > 0 ? (1 - lambda_dssim) * l1 + lambda_dssim * (1 - ssim) : 0, l1, ssim, num_instances};
}

/// What a rank says of a view when a step was computed. Only the rank that renders the view says more than how many
/// splats it has there.
struct ViewReport {
    ViewLoss loss;
    std::int64_t num_splats = 0;  ///< of the rank's own Gaussians, also where there was less room
    // Whether there was too little room for these splats, and for instances. The loss means nothing in the latter case.
    std::uint32_t lacks_splats = 0, lacks_instances = 0;
};
static_assert(sizeof(ViewReport) % 16 == 0, "reports travel between devices");

/// What becomes of a step: the last of these in this order that a report on its views asks for.
enum class StepDecision : std::uint32_t {
    kTake,
    kSkip,   ///< a loss is not finite
    kRepeat  ///< some rank had too little room
};

GS_HD StepDecision decide_step(const ViewReport& report) {
    if (report.lacks_splats || report.lacks_instances) return StepDecision::kRepeat;
    return gs_isfinite(report.loss.loss) ? StepDecision::kTake : StepDecision::kSkip;
}

inline StepDecision decide_step(std::span<const ViewReport> reports) {
    StepDecision decision = StepDecision::kTake;
    for (const ViewReport& report : reports) decision = std::max(decision, decide_step(report));
    return decision;
}

}  // namespace gs
