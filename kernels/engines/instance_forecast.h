// SPDX-License-Identifier: Apache-2.0
// The number of instances that views had lately, and that a view will have.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <unordered_map>

#include "kernels/requests.h"

namespace gs {

/// Follows a number that varies from step to step, such as the instances of views in random order.
class RecentMost {
  public:
    /// The number of steps in a window. Two of them show all views of most scenes.
    static constexpr int kWindow = 256;

    /// Returns the most of the last two windows, or of the first, at the end of one.
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

/// Foresees how many instances a view has. All of the room for instances is sorted, and views differ: room for the
/// largest is twice what a mean view of a photographed room needs.
///
/// A view's number is taken as a factor of its own times a level that all views share, which follows the training.
class InstanceForecast {
  public:
    /// Returns a number that the view's instances hardly exceed, or the largest if the view is unknown.
    std::int64_t most(ImageId view) const {
        const auto found = factors_.find(view);
        if (found == factors_.end()) return std::numeric_limits<std::int64_t>::max();
        return std::int64_t(std::min(kMargin * found->second * level_, kMost)) + kLeast;
    }
    /// Takes what a view had, if it is a known one.
    void note(ImageId view, std::int64_t num_instances) {
        if (!view.is_known()) return;
        const double n = double(std::max(num_instances, kLeast));
        if (level_ == 0) level_ = n;
        const auto [found, is_new] = factors_.try_emplace(view, n / level_);
        if (is_new) return;
        // What changes more than this does so for reasons of its own.
        level_ += kFollow * (std::clamp(n / found->second, level_ / 2, 2 * level_) - level_);
        found->second = n / level_;
    }

  private:
    static constexpr double kMargin = 1.25, kFollow = 0.2, kMost = 1e12;
    static constexpr std::int64_t kLeast = 1 << 14;  ///< what is not worth counting
    double level_ = 0;
    std::unordered_map<ImageId, double, ImageIdHash> factors_;
};

}  // namespace gs
