// SPDX-License-Identifier: Apache-2.0
// Packs a trained model, and the photometric correction with it, into the scene that a viewer loads.
#pragma once

#include "kernels/requests.h"
#include "kernels/state/gaussian_state.h"
#include "lib/export/ngsplat.h"
#include "lib/scene/scene.h"

namespace gs {

/// Packs the response of the first camera and, for free views, exposure and colour of the training image of median
/// exposure. `views` stays empty. `state` must be active.
PackedPpisp pack_ppisp(const PpispState& state);

/// Returns exposure and colour of a view. With the mode kController its camera's controller predicts them from the
/// uncorrected render; otherwise they are zero.
PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected);

/// Throws DataError naming group and row of the first parameter without meaning (lib/model/whole_model.h).
void require_finite(const Gaussians& gaussians);

/// Returns the Gaussians that can be visible, in their order: opacity at least 1/255 and a rotation with a direction.
Gaussians visible_gaussians(const Gaussians& gaussians);

/// Puts the rows in the order in which a viewer that shows what has arrived should get them: in kImportanceClasses
/// (lib/export/file_rows.h) by the root of score times opacity, largest first. Without `scores` (Backend::scores, one
/// per row, of views to train on) it is opacity times mean width, the root of the mean projected area. Rows of a class
/// keep their order, which is mostly that of the Morton curve, so that neighbours stay close in memory. Those with a
/// residual stay in front, and each part is ordered by itself. The optimizer state is dropped. Deterministic.
void order_by_importance(Gaussians& gaussians, const std::vector<float>& scores = {});

/// Gives the Gaussians of a mixed model that have no residual one that shows nothing, as viewers need it that know no
/// mixed models. Throws UsageError for a model without such a residual: one whose Gaussians share weights.
void complete_residuals(Gaussians& gaussians);

/// Packs all Gaussians: geometry and base colour in 16 bytes, the residual in its model's payload. Throws UsageError
/// for a model that has no packing.
PackedScene pack_gaussians(const Gaussians& gaussians);

/// Packs one Gaussian that shows nothing, with all degrees active: the sizes of a packed model are those of this one.
/// Throws as pack_gaussians.
PackedScene packed_sample(const AppearanceSpec& appearance);

/// Adds the cameras of `views` and the first view: the median of the means, the cameras' mean up, their median
/// distance. `views` are the test views, or training views if there are none.
void add_cameras(PackedScene& scene, const Gaussians& gaussians, const std::vector<View>& views);

}  // namespace gs
