// SPDX-License-Identifier: Apache-2.0
// Renders views one after another, or as many at the same time as the backend supports.
#pragma once

#include <vector>

#include "kernels/ranks/backend.h"

namespace gs {

/// Returns the images of views in their order. The model must not change before the last image has been taken.
class RenderQueue {
  public:
    RenderQueue(Backend& backend, std::vector<RenderRequest> views) : backend_(backend), views_(std::move(views)) {}

    /// Returns the next image.
    RenderedImage next();
    /// Returns the render time of the last image, s: its share of the time of the batch it was rendered in.
    double seconds() const { return seconds_; }

  private:
    Backend& backend_;
    const std::vector<RenderRequest> views_;
    std::size_t rendered_ = 0, taken_ = 0;  ///< numbers of views
    std::vector<RenderedImage> images_;     ///< images of the last batch
    double seconds_ = 0;
};

}  // namespace gs
