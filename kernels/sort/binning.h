// SPDX-License-Identifier: Apache-2.0
// Sorts visible Gaussians by depth, then their tile instances stably by tile (docs/math/rasterizer.md#sorting).
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/splat/depth_key.h"

namespace gs {

/// The touched tiles that preprocessing passes on: one list per part of kPartSize Gaussians.
struct BinningInput {
    struct Part {
        std::vector<std::uint64_t> depth_keys;  ///< (depth bits << 32 | Gaussian index) of the part's visible Gaussians
        std::vector<std::uint32_t> tiles;       ///< tile indices, Gaussian by Gaussian
    };
    std::vector<Part> parts;
    std::vector<std::uint32_t> first;  ///< (N) position of a Gaussian's first tile within its part's list
    std::vector<std::uint32_t> count;  ///< (N) number of touched tiles; 0 = culled
};

/// The sort, reusable from call to call. Its buffers grow and never shrink.
class TileBinning {
  public:
    /// Sorts the instances. Equal depths are ordered by index, so the result is unique and does not depend on the
    /// number of threads. Throws DeviceError if there are more than `max_instances` instances.
    void build(const BinningInput& in, std::uint32_t num_tiles, std::int64_t max_instances);

    const std::vector<Instance>& instances() const { return instances_; }
    /// Returns the bounds of the tiles' lists: tile t has the instances [offsets()[t], offsets()[t+1]).
    const std::vector<std::uint32_t>& offsets() const { return offsets_; }
    /// Returns the slot of each part's first instance.
    const std::vector<std::uint32_t>& part_slots() const { return part_slots_; }
    std::int64_t num_visible() const { return static_cast<std::int64_t>(keys_.size()); }

  private:
    void sort_by_depth(const BinningInput& in, std::int64_t visible);
    template <class ForItems, class Item>
    void sort_into_buckets(std::int64_t slices, std::uint32_t buckets, ForItems&& for_items, Item* out,
                           std::uint32_t* starts = nullptr);

    std::vector<std::uint64_t> keys_, sorted_keys_;
    std::vector<Instance> instances_;
    std::vector<std::uint32_t> offsets_, part_slots_, histogram_;
};

/// Returns the number of instances that fit: 2^31 - 1, or the number that fits half of the machine's memory at 64 bytes
/// each if that is less.
std::int64_t default_max_instances();

}  // namespace gs
