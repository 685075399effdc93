// SPDX-License-Identifier: Apache-2.0
// Renders where the surfaces of a model are, and how they lie.
#pragma once

#include <memory>
#include <vector>

#include "apps/gsapp/render/false_colors.h"
#include "eval/runs/saved_run.h"

namespace gs {

/// Blends depths and normals of Gaussians as pictures blend their colours. The rasterizer blends colours alone, so a
/// second backend holds the model without appearance, and each view gives its Gaussians base colours that carry the
/// quantity (docs/guide.md#depth-normals-and-alpha).
class GeometryRenderer {
  public:
    /// Takes the geometry of the model that the run's backend holds.
    explicit GeometryRenderer(const SavedRun& run);

    /// Returns the depth of each pixel, (H,W). A Gaussian's depth z is the distance of its mean along the camera's
    /// forward axis, in scene units. Expected is sum(w z) / sum(w) over the fragments, and 0 if nothing is seen; the
    /// median is the z of one Gaussian, and 0 if the pixel's alpha is below 1/2.
    std::vector<float> depth(const Camera& camera, DepthKind kind = DepthKind::kExpected);

    /// Returns the normal of each pixel, (H,W,3): the blended directions of the Gaussians' shortest axes, each turned
    /// to the camera, in the scene's axes and of length 1. 0 if nothing is seen or the directions cancel.
    std::vector<float> normals(const Camera& camera);

  private:
    RenderedImage render(const Camera& camera, bool median = false);

    double scale_;     ///< frame units per scene unit
    Gaussians model_;  ///< its base colours are those of the view that was asked last
    std::unique_ptr<Backend> backend_;
};

}  // namespace gs
