// SPDX-License-Identifier: Apache-2.0
// A depth sort of Gaussians, then a counting sort of their instances by tile.
#include "kernels/sort/binning.h"

#include <unistd.h>

#include <algorithm>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"

namespace gs {

std::int64_t default_max_instances() {
    // Bytes: instance 8, block mask 2, gradient sums 36, tile list in preprocessing 4; rounded up for growth.
    constexpr std::int64_t kBytesPerInstance = 64;
    const std::int64_t memory = std::int64_t(sysconf(_SC_PHYS_PAGES)) * sysconf(_SC_PAGE_SIZE);
    return std::min<std::int64_t>((std::int64_t(1) << 31) - 1, memory / 2 / kBytesPerInstance);
}

void TileBinning::build(const BinningInput& in, std::uint32_t num_tiles, std::int64_t max_instances) {
    const std::int64_t parts = static_cast<std::int64_t>(in.parts.size());
    part_slots_.resize(parts);
    std::int64_t total = 0, visible = 0;
    for (std::int64_t p = 0; p < parts; ++p) {
        part_slots_[p] = static_cast<std::uint32_t>(total);
        total += static_cast<std::int64_t>(in.parts[p].tiles.size());
        visible += static_cast<std::int64_t>(in.parts[p].depth_keys.size());
        if (total > max_instances)
            throw DeviceError(
                "more than " + std::to_string(max_instances) +
                " Gaussian-tile instances in one view (limit of memory or of 32-bit indices); likely cause: many "
                "Gaussians larger than the image. Lower --cap-max, raise --scale-reg or render at a lower "
                "--resolution");
    }
    keys_.resize(visible);
    std::int64_t at = 0;
    for (const auto& part : in.parts) {
        std::copy(part.depth_keys.begin(), part.depth_keys.end(), keys_.begin() + at);
        at += static_cast<std::int64_t>(part.depth_keys.size());
    }
    parallel_sort(keys_.data(), keys_.data() + keys_.size());

    // The counting sort by tile runs over fixed slices of the depth order. It is stable for any assignment of threads.
    constexpr std::int64_t kSlices = 16;
    const std::int64_t slice = (visible + kSlices - 1) / kSlices;
    histogram_.assign(std::size_t(kSlices) * num_tiles, 0);
    const auto for_slice = [&](std::int64_t s, auto&& fn) {
        for (std::int64_t k = s * slice, end = std::min(visible, (s + 1) * slice); k < end; ++k) {
            const std::uint32_t g = static_cast<std::uint32_t>(keys_[k]);
            const std::int64_t part = g / kPartSize;
            const std::uint32_t first = in.first[g];
            for (std::uint32_t j = 0; j < in.count[g]; ++j)
                fn(g, in.parts[part].tiles[first + j], part_slots_[part] + first + j);
        }
    };
    parallel_for(kSlices, [&](std::int64_t s) {
        std::uint32_t* h = &histogram_[std::size_t(s) * num_tiles];
        for_slice(s, [&](std::uint32_t, std::uint32_t tile, std::uint32_t) { ++h[tile]; });
    });
    offsets_.resize(num_tiles + 1);
    std::uint32_t sum = 0;
    for (std::uint32_t t = 0; t < num_tiles; ++t) {
        offsets_[t] = sum;
        for (std::int64_t s = 0; s < kSlices; ++s) {
            std::uint32_t& h = histogram_[std::size_t(s) * num_tiles + t];
            const std::uint32_t n = h;
            h = sum;
            sum += n;
        }
    }
    offsets_[num_tiles] = sum;
    instances_.resize(total);
    parallel_for(kSlices, [&](std::int64_t s) {
        std::uint32_t* h = &histogram_[std::size_t(s) * num_tiles];
        for_slice(s, [&](std::uint32_t g, std::uint32_t tile, std::uint32_t slot) {
            instances_[h[tile]++] = {g, slot};
        });
    });
}

}  // namespace gs
