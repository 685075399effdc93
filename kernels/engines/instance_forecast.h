// SPDX-License-Identifier: Apache-2.0
// The number of instances of recent views, and a forecast for a view.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <unordered_map>

#include "kernels/requests.h"

namespace gs {

/// Tracks the maximum of a number that varies from step to step, such as the instances of views in random order.
class RecentMost {
  public:
    /// Number of steps in a window. Two windows cover all views of most scenes.
    static constexpr int kWindow = 256;

    /// Returns the maximum of the last two windows, or of the first, at the end of a window; otherwise nothing.
    std::optional<std::int64_t> add(std::int64_t n) {
        now_ = std::max(now_, n);
        if (++steps_ < kWindow) return std::nullopt;
        const std::int64_t most = std::max(now_, before_);
        before_ = now_, now_ = 0, steps_ = 0;
        return most;
    }

  private:
    std::int64_t now_ = 0, before_ = 0;
    int steps_ = 0;
};

/// Predicts the number of instances of a view. All of the room for instances is sorted, and views differ: room for the
/// largest view is twice the need of a mean view of a photographed room.
///
/// The number of a view is modelled as a factor of the view times a level common to all views, which follows the
/// training.
class InstanceForecast {
  public:
    /// Returns a number that the view's instances rarely exceed, or the largest number if the view is unknown.
    std::int64_t most(ImageId view) const {
        const auto found = factors_.find(view);
        if (found == factors_.end()) return std::numeric_limits<std::int64_t>::max();
        return std::int64_t(std::min(kMargin * found->second * level_, kMost)) + kLeast;
    }
    /// Records the number of instances of a view, if the view is known.
    void note(ImageId view, std::int64_t num_instances) {
        if (!view.is_known()) return;
        const double n = double(std::max(num_instances, kLeast));
        if (level_ == 0) level_ = n;
        const auto [found, is_new] = factors_.try_emplace(view, n / level_);
        if (is_new) return;
        // A larger change than this has causes specific to the view.
        level_ += kFollow * (std::clamp(n / found->second, level_ / 2, 2 * level_) - level_);
        found->second = n / level_;
    }

  private:
    static constexpr double kMargin = 1.25, kFollow = 0.2, kMost = 1e12;
    static constexpr std::int64_t kLeast = 1 << 14;  ///< smallest number worth tracking
    double level_ = 0;
    std::unordered_map<ImageId, double, ImageIdHash> factors_;
};

}  // namespace gs
