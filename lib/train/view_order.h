// SPDX-License-Identifier: Apache-2.0
// Determines the view of each iteration.
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// A new random permutation of all views in every epoch. It depends only on (seed, iteration), so a resumed run needs
/// no stored state.
class ViewOrder {
  public:
    ViewOrder(std::size_t num_views, std::uint64_t seed) : num_views_(num_views), seed_(seed) {}
    std::size_t at(std::int64_t iteration);

  private:
    std::size_t num_views_;
    std::uint64_t seed_;
    std::int64_t epoch_ = -1;
    std::vector<std::size_t> order_;  ///< permutation of `epoch_`
};

}  // namespace gs
