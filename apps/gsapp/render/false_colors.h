// SPDX-License-Identifier: Apache-2.0
// False-colour images of depth, and of the view dependence of each Gaussian's colour.
#pragma once

#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

/// Depth of a pixel: the mean depth of its Gaussians, weighted as their colours are, or the depth of the Gaussian at
/// which transmittance falls to 1/2 or below.
enum class DepthKind { kExpected, kMedian };

inline constexpr DepthKind kDepthKinds[] = {DepthKind::kExpected, DepthKind::kMedian};

/// Returns the name of the folder for this kind of depth.
constexpr const char* depth_folder(DepthKind kind) { return kind == DepthKind::kMedian ? "median_depth" : "depth"; }

/// Depth range of the colour map, in scene units.
struct DepthRange {
    double near = 0, far = 0;
};

/// Finds the common range of the depth images of one folder. A shared range prevents flickering in a video.
class DepthRangeFinder {
  public:
    /// Adds an image. Only pixels with alpha of at least 1/2 count; of these the nearest and the farthest hundredth are
    /// ignored, because single Gaussians can float anywhere.
    void add(const std::vector<float>& depth, const std::vector<float>& alpha);

    /// Returns the range of all images; {0, 0} if no pixel counts.
    DepthRange range() const { return found_ ? range_ : DepthRange{}; }

  private:
    DepthRange range_;
    bool found_ = false;
};

/// Returns depths as 8-bit colours of even lightness steps: yellow at `near` and nearer, through green and blue to
/// purple at `far` and farther; black for depth 0. `depth` is (H,W).
Image colored_depth(const std::vector<float>& depth, int width, int height, const DepthRange& range);

/// Returns the content of range.json for such images: the range, and the meaning of values and colours.
std::string depth_range_text(const DepthRange& range, DepthKind kind);

/// Returns the model with one colour per Gaussian and without photometric correction: grey without a residual;
/// otherwise from blue to yellow by the mean change of its colour over channels and up to 32 of `views`, yellow from a
/// change of 1/4 on.
Gaussians appearance_colors(const Gaussians& model, const std::vector<View>& views);

}  // namespace gs
