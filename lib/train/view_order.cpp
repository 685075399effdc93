// SPDX-License-Identifier: Apache-2.0
// Shuffles the views of each epoch.
#include "lib/train/view_order.h"

#include <numeric>
#include <utility>

#include "kernels/base/rng.h"

namespace gs {

std::size_t ViewOrder::at(std::int64_t iteration) {
    const auto views = static_cast<std::int64_t>(num_views_);
    if (iteration / views != epoch_) {
        epoch_ = iteration / views;
        order_.resize(num_views_);
        std::iota(order_.begin(), order_.end(), std::size_t(0));
        for (std::size_t i = num_views_; i > 1; --i) {  // Fisher-Yates
            const Philox4 r = philox(seed_, RngStream::kViewOrder, std::uint64_t(epoch_), std::uint32_t(i));
            std::swap(order_[i - 1], order_[(std::uint64_t(r.v[0]) * i) >> 32]);
        }
    }
    return order_[iteration % views];
}

}  // namespace gs
