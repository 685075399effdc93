// SPDX-License-Identifier: Apache-2.0
// The room that ranks keep for the splats of a view, so that none has to wait for the others' numbers of splats.
#pragma once

#include <algorithm>
#include <cstdint>
#include <unordered_map>

namespace gs {

/// Foresees what share of a rank's Gaussians a view shows. All ranks note the same and so foresee the same. Rows are
/// dealt so that ranks show about equal shares.
class SplatRooms {
  public:
    /// Returns a number that the splats of a rank with `rows` Gaussians hardly exceed in a view, at most `rows`.
    std::size_t room(std::int64_t view, std::int64_t rows) const {
        const auto found = shares_.find(view);
        const double share = found == shares_.end() ? largest_ : found->second;
        return std::size_t(std::min(double(rows), kMargin * share * double(rows) + kLeast));
    }
    /// Takes the largest share that any rank showed. A view below 0 is an unknown one. What it needed then it has room
    /// for from now on.
    void note(std::int64_t view, double share) {
        if (view >= 0) shares_[view] = share;
        largest_ = std::max(largest_, share);
    }

  private:
    static constexpr double kMargin = 1.0625, kLeast = 16;
    double largest_ = 0.25;  ///< what is made room for in views that were not seen yet
    std::unordered_map<std::int64_t, double> shares_;
};

}  // namespace gs
