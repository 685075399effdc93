// SPDX-License-Identifier: Apache-2.0
// Depths as pictures.
#pragma once

#include <string>
#include <vector>

#include "eval/runs/depth_kind.h"
#include "lib/io/image.h"

namespace gs {

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

    /// Returns the range of all pictures; {0, 0} where no pixel counts.
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

}  // namespace gs
