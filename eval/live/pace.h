// SPDX-License-Identifier: Apache-2.0
// How often a training stops for those who watch it.
#pragma once

#include <algorithm>

namespace gs {

/// Spaces out work that costs the training time, so that it takes at most a small share of it.
class Pace {
  public:
    static constexpr double kMostShare = 0.03;    ///< of the time from the beginning of one piece of work to the next
    static constexpr double kLeastSeconds = 2.0;  ///< between two pieces

    bool due(double now) const { return now >= next_; }
    /// Says that work was begun at `start` and cost `seconds`.
    void spent(double start, double seconds) { next_ = start + std::max(kLeastSeconds, seconds / kMostShare); }

  private:
    double next_ = 0;
};

}  // namespace gs
