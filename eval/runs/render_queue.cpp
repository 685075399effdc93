// SPDX-License-Identifier: Apache-2.0
// Renders the next batch of views after all images of the last batch have been taken.
#include "eval/runs/render_queue.h"

#include <algorithm>

#include "kernels/base/clock.h"

namespace gs {

RenderedImage RenderQueue::next() {
    if (taken_ == rendered_) {
        const std::size_t count = std::min(views_.size() - taken_, std::size_t(backend_.views_at_once()));
        const auto first = views_.begin() + std::ptrdiff_t(taken_);
        const std::vector<RenderRequest> some(first, first + std::ptrdiff_t(count));
        const double start = seconds_now();
        backend_.render_all(some, images_);
        seconds_ = (seconds_now() - start) / double(count);
        rendered_ += count;
    }
    const std::size_t left = rendered_ - taken_++;
    return std::move(images_[images_.size() - left]);
}

}  // namespace gs
