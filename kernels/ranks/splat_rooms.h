// SPDX-License-Identifier: Apache-2.0
// The room that ranks keep for the splats of a view, so that none has to wait for the others' numbers of splats.
#pragma once

#include <algorithm>
#include <cstdint>
#include <unordered_map>

namespace gs {

/// Foresees what share of a rank's Gaussians a view shows. All ranks note the same and so foresee the same: in whole
/// numbers, which round alike on every machine. Rows are dealt so that ranks show about equal shares.
class SplatRooms {
  public:
    /// Returns what share `num` of `rows` Gaussians are, rounded up, in units of 2^-20.
    static std::uint64_t share(std::uint64_t num, std::int64_t rows) {
        return rows > 0 ? (num * kOne + std::uint64_t(rows) - 1) / std::uint64_t(rows) : 0;
    }
    /// Returns a number that the splats of a rank with `rows` Gaussians hardly exceed in a view, at most `rows`.
    std::size_t room(std::int64_t view, std::int64_t rows) const {
        const auto found = shares_.find(view);
        const std::uint64_t share = found == shares_.end() ? largest_ : found->second;
        return std::min<std::uint64_t>(rows, (share + share / kMargin) * std::uint64_t(rows) / kOne + kLeast);
    }
    /// Takes the largest share that any rank showed. A view below 0 is an unknown one. What it needed then it has room
    /// for from now on.
    void note(std::int64_t view, std::uint64_t share) {
        if (view >= 0) shares_[view] = share;
        largest_ = std::max(largest_, share);
    }

  private:
    static constexpr std::uint64_t kOne = 1 << 20, kMargin = 8, kLeast = 16;
    std::uint64_t largest_ = kOne / 4;  ///< what is made room for in views that were not seen yet
    std::unordered_map<std::int64_t, std::uint64_t> shares_;
};

}  // namespace gs
