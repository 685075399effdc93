// SPDX-License-Identifier: Apache-2.0
// Renders the depth and the normals of a model.
#pragma once

#include <memory>
#include <vector>

#include "apps/gsapp/render/false_colors.h"
#include "eval/runs/saved_run.h"

namespace gs {

/// Blends depths and normals of Gaussians with the same weights as their colours. The rasterizer blends only colours,
/// so a second backend holds the model without appearance, and the base colours of its Gaussians encode the quantity
/// for each view (docs/guide.md#depth-normals-and-alpha).
class GeometryRenderer {
  public:
    /// Copies the geometry of the model that the run's backend holds.
    explicit GeometryRenderer(const SavedRun& run);

    /// Returns the depth of each pixel, (H,W). A Gaussian's depth z is the distance of its mean along the camera's
    /// forward axis, in scene units. The expected depth is sum(w z) / sum(w) over the fragments, and 0 if nothing is
    /// visible; the median depth is the z of one Gaussian, and 0 if the pixel's alpha is below 1/2.
    std::vector<float> depth(const Camera& camera, DepthKind kind = DepthKind::kExpected);

    /// Returns the normal of each pixel, (H,W,3): the blended directions of the Gaussians' shortest axes, each oriented
    /// towards the camera, in the scene's axes and of length 1. 0 if nothing is visible or the directions cancel.
    std::vector<float> normals(const Camera& camera);

  private:
    RenderedImage render(const Camera& camera, bool median = false);

    double scale_;     ///< frame units per scene unit
    Gaussians model_;  ///< geometry, with base colours for the last rendered view
    std::unique_ptr<Backend> backend_;
};

}  // namespace gs
