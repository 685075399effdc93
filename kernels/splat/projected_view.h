// SPDX-License-Identifier: Apache-2.0
// The splats of a view on their way between ranks, and the sums over pixels that come back for them.
#pragma once

#include <vector>

#include "kernels/base/device_array.h"
#include "kernels/base/parallel.h"
#include "kernels/splat/camera.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The splats of some Gaussians in one view, in the order of their rows.
struct ProjectedView {
    /// Makes an empty one in the memory of `device`, or of the host if that is null.
    explicit ProjectedView(DeviceStream* device = nullptr) : splats(device), rows(device), places(device) {}

    DeviceArray<WireSplat> splats;
    DeviceArray<std::uint32_t> rows;     ///< of the splats, but not of a step's on a device
    DeviceArray<SplatPlaces> places;     ///< of a step's on a device: (Gaussians / 32, rounded up)
    std::vector<std::size_t> part_ends;  ///< (parts of kPartSize rows) number of splats up to the end of each
};

/// The splats of a view in parts, one from each rank in the order of the ranks, and what is summed up for each of them.
using SplatParts = std::vector<const DeviceArray<WireSplat>*>;
template <class Sum> using SumParts = std::vector<DeviceArray<Sum>*>;
using RowParts = std::vector<DeviceArray<std::uint32_t>>;

inline std::size_t num_splats(const SplatParts& parts) {
    std::size_t sum = 0;
    for (const auto* part : parts) sum += part->size();
    return sum;
}
/// Calls write(k, sum) for the k-th of all splats, where sums are on the host.
template <class Sum, class Write> void write_sums(const SplatParts& splats, const SumParts<Sum>& sums, Write&& write) {
    std::int64_t first = 0;
    for (std::size_t part = 0; part < splats.size(); ++part) {
        const auto size = std::int64_t(splats[part]->size());
        Sum* const out = sums[part]->resize(std::size_t(size));
        parallel_for_rows(size, [&](std::int64_t k) { write(first + k, out[k]); });
        first += size;
    }
}

/// Places in memory that the device uses for other things at other times; null if there are none.
struct ScratchPlaces {
    std::byte* splats = nullptr;  ///< what lies here is lost when loss_of_splats() has read its splats
    std::byte* sums = nullptr;    ///< this is free when loss_of_splats() writes sums, and then until the next view
};

/// The sums of one splat over the pixels of a view that say what its residual is worth.
struct ResidualSplatSums {
    float weight;          ///< of the view's mask
    Vec3<float> gradient;  ///< of half the squared error by the colour
};

/// Returns the number of values of a rank's gradient of so many shared weights: arrays that pass between ranks begin at
/// multiples of 16 bytes.
constexpr std::size_t shared_row(std::size_t num_weights) { return (num_weights + 3) / 4 * 4; }

}  // namespace gs
