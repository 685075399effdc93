// SPDX-License-Identifier: Apache-2.0
// A radix sort of Gaussians by depth, then a counting sort of their instances by tile.
#include "kernels/sort/binning.h"

#include <unistd.h>

#include <algorithm>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/splat/depth_key.h"

namespace gs {
namespace {

constexpr std::int64_t kMaxSlices = 16;  ///< maximum number of slices that threads process in a counting pass

}  // namespace

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
    sort_by_depth(in, visible);

    const std::int64_t slice = (visible + kMaxSlices - 1) / kMaxSlices;
    instances_.resize(total);
    offsets_.resize(num_tiles + 1);
    sort_into_buckets(
        kMaxSlices, num_tiles,
        [&](std::int64_t s, auto&& put) {
            for (std::int64_t k = s * slice, end = std::min(visible, (s + 1) * slice); k < end; ++k) {
                const std::uint32_t g = static_cast<std::uint32_t>(keys_[k]), first = in.first[g];
                const std::int64_t part = g / kPartSize;
                const std::uint32_t* tiles = in.parts[part].tiles.data();
                for (std::uint32_t j = first, last = first + in.count[g]; j < last; ++j)
                    put(tiles[j], Instance{g, part_slots_[part] + j});
            }
        },
        instances_.data(), offsets_.data());
    offsets_[num_tiles] = static_cast<std::uint32_t>(total);
}

/// Sorts the keys of all parts by depth. The keys are in index order, and equal depths keep this order.
void TileBinning::sort_by_depth(const BinningInput& in, std::int64_t visible) {
    constexpr int kDigitBits = 8;  // passes of 12 bits are faster up to 13,000 keys and slower beyond
    constexpr std::uint32_t kDigits = 1u << kDigitBits;
    static_assert(kDepthKeyBits % kDigitBits == 0);
    const std::int64_t parts = static_cast<std::int64_t>(in.parts.size());
    const std::int64_t slices = std::clamp<std::int64_t>(visible / 4096, 1, kMaxSlices);  // few keys need one
    const std::int64_t slice = (visible + slices - 1) / slices, part_slice = (parts + slices - 1) / slices;
    keys_.resize(visible);
    sorted_keys_.resize(visible);
    for (int shift = 32; shift < 32 + kDepthKeyBits; shift += kDigitBits) {
        const auto digit = [&](std::uint64_t key) { return static_cast<std::uint32_t>(key >> shift) % kDigits; };
        const auto put_parts = [&](std::int64_t s, auto&& put) {
            for (std::int64_t p = s * part_slice, end = std::min(parts, (s + 1) * part_slice); p < end; ++p)
                for (const std::uint64_t key : in.parts[p].depth_keys) put(digit(key), key);
        };
        const auto put_keys = [&](std::int64_t s, auto&& put) {
            for (std::int64_t k = s * slice, end = std::min(visible, (s + 1) * slice); k < end; ++k)
                put(digit(keys_[k]), keys_[k]);
        };
        if (shift == 32)
            sort_into_buckets(slices, kDigits, put_parts, sorted_keys_.data());
        else
            sort_into_buckets(slices, kDigits, put_keys, sorted_keys_.data());
        keys_.swap(sorted_keys_);
    }
}

/// Moves items into buckets, keeping the order within each bucket. for_items(slice, put) calls put(bucket, item) for
/// each item of a slice in order. Results do not depend on the number of slices. If `starts` is not null, it receives
/// the position of each bucket's first item.
template <class ForItems, class Item>
void TileBinning::sort_into_buckets(std::int64_t slices, std::uint32_t buckets, ForItems&& for_items, Item* out,
                                    std::uint32_t* starts) {
    histogram_.assign(std::size_t(slices) * buckets, 0);
    parallel_for(slices, [&](std::int64_t s) {
        std::uint32_t* h = &histogram_[std::size_t(s) * buckets];
        for_items(s, [&](std::uint32_t bucket, const Item&) { ++h[bucket]; });
    });
    std::uint32_t sum = 0;
    for (std::uint32_t b = 0; b < buckets; ++b) {
        if (starts) starts[b] = sum;
        for (std::int64_t s = 0; s < slices; ++s) {
            std::uint32_t& h = histogram_[std::size_t(s) * buckets + b];
            const std::uint32_t n = h;
            h = sum;
            sum += n;
        }
    }
    parallel_for(slices, [&](std::int64_t s) {
        std::uint32_t* h = &histogram_[std::size_t(s) * buckets];
        for_items(s, [&](std::uint32_t bucket, const Item& item) { out[h[bucket]++] = item; });
    });
}

}  // namespace gs
