// SPDX-License-Identifier: Apache-2.0
// Pictures of what has no colour: depths, and how much the colour of each Gaussian depends on the view.
#pragma once

#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

/// A depth of a pixel: the mean of its Gaussians' by the weights of their colours, or that of the one at which
/// transmittance falls to 1/2 or below.
enum class DepthKind { kExpected, kMedian };

inline constexpr DepthKind kDepthKinds[] = {DepthKind::kExpected, DepthKind::kMedian};

/// Returns the name of the folder with such depths.
constexpr const char* depth_folder(DepthKind kind) { return kind == DepthKind::kMedian ? "median_depth" : "depth"; }

/// The depths that colours tell apart, in scene units.
struct DepthRange {
    double near = 0, far = 0;
};

/// The range of the pictures of one folder. Its colours are common to them, so that a video does not flicker.
class DepthRangeFinder {
  public:
    /// Adds a picture. Only pixels that are at least half covered count; of these the nearest and the farthest
    /// hundredth do not, because single Gaussians float anywhere.
    void add(const std::vector<float>& depth, const std::vector<float>& alpha);

    /// Returns the range of all pictures; {0, 0} if no pixel counts.
    DepthRange range() const { return found_ ? range_ : DepthRange{}; }

  private:
    DepthRange range_;
    bool found_ = false;
};

/// Returns depths as 8-bit colours: yellow at `near` and nearer, through green and blue to purple at `far` and farther,
/// evenly in lightness; black where the depth is 0. `depth` is (H,W).
Image colored_depth(const std::vector<float>& depth, int width, int height, const DepthRange& range);

/// Returns what range.json says beside such pictures: the range, and what values and colours mean.
std::string depth_range_text(const DepthRange& range, DepthKind kind);

/// Returns the model with one colour a Gaussian, and no correction: grey without a residual; else from blue to yellow
/// by the mean change of its colour over channels and up to 32 of `views`, yellow from a quarter on.
Gaussians appearance_colors(const Gaussians& model, const std::vector<View>& views);

}  // namespace gs
