// SPDX-License-Identifier: Apache-2.0
// A model in training on the host, and its arrays in the form for kernels. Backends upload and download it, and files
// store it.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "kernels/base/appearance_spec.h"
#include "kernels/state/ppisp_state.h"

namespace gs {

/// The parameter groups of one Gaussian, in file order. Densification treats all of them alike, as rows.
enum class Group : int { kMean, kScale, kRotation, kOpacity, kBase, kResidual, kSmoothing };
inline constexpr int kNumGroups = 7;
inline constexpr std::array<const char*, kNumGroups> kGroupNames = {
    "means", "raw_scales", "rotations", "raw_opacities", "base_colors", "residuals", "smoothing"};

/// The values of one group, `width` per Gaussian, row-major (N, width).
template <class Real> struct GroupArrays {
    int width = 0;
    std::vector<Real> param;  ///< raw (pre-activation) values
    std::vector<Real> m, v;   ///< Adam moments; empty if the optimizer state was dropped
};

/// All Gaussians of a model. The groups are means (N,3) in frame units; raw_scales (N,3), log; rotations (N,4), w,x,y,z
/// unnormalised; raw_opacities (N,1), logit; base_colors (N,3), pre-activation with Y0 folded in; residuals (N,R) in
/// the model's own layout; smoothing (N,1), the variance of the 3-D filter in frame units squared, which follows from
/// the training cameras and is in no gradient. Its width is 0 without the filter, as in every saved model.
template <class Real> struct GaussianState {
    std::int64_t count = 0;
    AppearanceSpec appearance;
    int active_degree = 0;
    /// Whether splats are dilated by kAntialiasedDilation and their opacity compensates for it
    /// (docs/math/rasterizer.md#antialiasing).
    bool antialiased = false;
    std::int64_t step = 0;  ///< optimizer steps, including skipped ones; Adam's t
    std::array<GroupArrays<Real>, kNumGroups> groups;
    /// Weights shared by all Gaussians, one row in the model's own layout; width 0 if the model has none.
    GroupArrays<Real> shared;
    /// The ADC statistic since the last densification, one value per Gaussian: the summed norm of the screen-space mean
    /// gradient, and the number of views that showed the Gaussian. Both are empty if they are not gathered.
    std::vector<Real> gradient_sum, gradient_count;
    /// Last step of each Gaussian, if only visible Gaussians take steps; else empty. Integers, which are exact up to
    /// 2^24.
    std::vector<Real> last_step;
    PpispState ppisp;  ///< photometric differences between the training images; inactive if a scene needs none

    /// Returns K, the number of Gaussians with a residual, which are the first ones. The residual group only has rows
    /// for these. 0 for a model without residuals.
    std::int64_t num_residuals() const {
        const auto& residuals = (*this)[Group::kResidual];
        return residuals.width > 0 ? std::int64_t(residuals.param.size()) / residuals.width : 0;
    }
    /// Returns whether some Gaussians lack the residual that the model has.
    bool is_mixed() const { return (*this)[Group::kResidual].width > 0 && num_residuals() < count; }
    /// Returns the number of rows of a group's arrays.
    std::int64_t num_rows(Group g) const { return g == Group::kResidual && is_mixed() ? num_residuals() : count; }

    GroupArrays<Real>& operator[](Group g) { return groups[static_cast<int>(g)]; }
    const GroupArrays<Real>& operator[](Group g) const { return groups[static_cast<int>(g)]; }
};

using Gaussians = GaussianState<float>;

/// The rows of a model, or of a part of it.
struct RowCounts {
    std::int64_t count = 0, num_residuals = 0;  ///< all Gaussians, and those with a residual, stored first
};

/// Pointers to the rows of all groups.
struct ModelArrays {
    float *param[kNumGroups], *m[kNumGroups], *v[kNumGroups];
    int width[kNumGroups];
    float *gradient_sum, *gradient_count;       ///< ADC statistic, or null
    float* last_step;                           ///< as in GaussianState, or null if all Gaussians take each step
    float *shared_param, *shared_m, *shared_v;  ///< weights shared by all Gaussians, or null
};

}  // namespace gs
