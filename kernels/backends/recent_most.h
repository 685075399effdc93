// SPDX-License-Identifier: Apache-2.0
// The most that was needed lately.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

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

}  // namespace gs
