// SPDX-License-Identifier: Apache-2.0
// Packs a trained model and its photometric correction into the scene that a viewer loads.
#pragma once

#include "kernels/requests.h"
#include "kernels/state/gaussian_state.h"
#include "lib/export/ngsplat.h"
#include "lib/scene/scene.h"

namespace gs {

/// Packs the response of the first camera and, for free views, exposure and colour of the training image with the
/// median exposure. `views` stays empty. `state` must be active.
PackedPpisp pack_ppisp(const PpispState& state);

/// Returns exposure and colour of a view. With the mode kController its camera's controller predicts them from the
/// uncorrected render; otherwise they are zero.
PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected);

/// Throws DataError naming group and row of the first invalid parameter (lib/model/whole_model.h).
void require_finite(const Gaussians& gaussians);

/// Returns the Gaussians that can be visible, in their order: opacity at least 1/255 and a nonzero rotation.
Gaussians visible_gaussians(const Gaussians& gaussians);

/// Sorts the rows for viewers that render a partly loaded file: into kImportanceClasses classes
/// (lib/export/file_rows.h) by the root of score times opacity, largest first. Without `scores` (Backend::scores, one
/// per row, over training views) the importance is opacity times mean width, the root of the mean projected area. Rows
/// of a class keep their order, which is mostly Morton order, so that neighbours stay close in memory. Rows with a
/// residual stay in front, and each of the two parts is sorted separately. The optimizer state is dropped.
/// Deterministic.
void order_by_importance(Gaussians& gaussians, const std::vector<float>& scores = {});

/// Adds a zero residual to the Gaussians of a mixed model that have none, for viewers without support for mixed models.
/// Throws UsageError if the model has no such residual, because its Gaussians share weights.
void complete_residuals(Gaussians& gaussians);

/// Packs all Gaussians: geometry and base colour in 16 bytes, the residual in its model's payload. Throws UsageError if
/// the model has no packing.
PackedScene pack_gaussians(const Gaussians& gaussians);

/// Packs one invisible Gaussian with all degrees active. Packed models of this appearance have the same sizes per
/// Gaussian. Throws as pack_gaussians does.
PackedScene packed_sample(const AppearanceSpec& appearance);

/// Adds the cameras of `views` and sets the first view: the median of the means, the cameras' mean up vector, and their
/// median distance. `views` are the test views, or the training views if there are none.
void add_cameras(PackedScene& scene, const Gaussians& gaussians, const std::vector<View>& views);

}  // namespace gs
