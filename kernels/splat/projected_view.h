// SPDX-License-Identifier: Apache-2.0
// The splats of a view as sent between ranks, and the sums over pixels returned for them.
#pragma once

#include <vector>

#include "kernels/base/device_array.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/splat/camera.h"
#include "kernels/splat/camera_gradient.h"
#include "kernels/splat/wire_splat.h"

namespace gs {

/// The splats of some Gaussians in one view, in the order of their rows.
struct ProjectedView {
    /// Makes an empty view in the memory of `device`, or in host memory if it is null.
    explicit ProjectedView(DeviceStream* device = nullptr) : splats(device), rows(device), places(device) {}

    DeviceArray<WireSplat> splats;
    DeviceArray<std::uint32_t> rows;     ///< rows of the splats; unused for a step on a device
    DeviceArray<SplatPlaces> places;     ///< places of the splats for a step on a device: (Gaussians / 32, rounded up)
    std::vector<std::size_t> part_ends;  ///< (parts of kPartSize rows) number of splats up to the end of each
};

/// The splats of a view in parts, one from each rank in rank order, and the sums for each of the splats.
using SplatParts = std::vector<const DeviceArray<WireSplat>*>;
template <class Sum> using SumParts = std::vector<DeviceArray<Sum>*>;
using RowParts = std::vector<DeviceArray<std::uint32_t>>;

inline std::size_t num_splats(const SplatParts& parts) {
    std::size_t sum = 0;
    for (const auto* part : parts) sum += part->size();
    return sum;
}
/// Calls write(k, sum) for the k-th of all splats. The sums must be in host memory.
template <class Sum, class Write> void write_sums(const SplatParts& splats, const SumParts<Sum>& sums, Write&& write) {
    std::int64_t first = 0;
    for (std::size_t part = 0; part < splats.size(); ++part) {
        const auto size = std::int64_t(splats[part]->size());
        Sum* const out = sums[part]->resize(std::size_t(size));
        parallel_for_rows(size, [&](std::int64_t k) { write(first + k, out[k]); });
        first += size;
    }
}

/// Places in memory that the device also uses for other purposes; null if there are none.
struct ScratchPlaces {
    std::byte* splats = nullptr;  ///< place of splats; overwritten once loss_of_splats() has read its splats
    std::byte* sums = nullptr;    ///< place of sums; free from when loss_of_splats() writes sums until the next view
};

/// The sums of one splat over the pixels of a view that determine the value of its residual.
struct ResidualSplatSums {
    float weight;          ///< sum of blending weights, weighted by the view's mask
    Vec3<float> gradient;  ///< gradient of half the squared error by the colour
};

/// Returns the padded length of a rank's gradients of `num_weights` shared weights and of `num_cameras` cameras: arrays
/// sent between ranks begin at multiples of 16 bytes.
constexpr std::size_t shared_row(std::size_t num_weights, std::size_t num_cameras = 0) {
    return (num_weights + num_cameras * CameraGradient<float>::kSize + 3) / 4 * 4;
}

}  // namespace gs
