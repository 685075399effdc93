// SPDX-License-Identifier: Apache-2.0
// Finds the medians of pixels on the device. It walks the lists of the forward pass again, so that frames which do not
// ask for medians pay nothing for them.
#include "kernels/blend/median_cuda.h"
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

/// Writes the medians of a tile. A warp walks the list for a sub-tile until all its pixels have theirs.
__global__ void __launch_bounds__(kCudaTilePixels)
    find_medians(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image) {
    __shared__ PackedSplat batches[kSubTiles][32];
    const int tile = int(blockIdx.x), warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 sub_tile = sub_tile_corner(tile_corner(tile, bins.tiles_x), warp), pixel = pixel_of(sub_tile, lane);
    const bool inside = pixel.x < image.width && pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    PackedSplat* batch = batches[warp];
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f;
    for (std::uint32_t base = begin; base < end; base += 32) {
        if (__all_sync(~0u, p.t <= float(kMedianTransmittance))) break;
        PackedSplat mine{};
        bool hit = false;
        if (base + lane < end) {
            const std::uint32_t instance = bins.instances[base + lane];
            mine = splats[bins.gaussians ? bins.gaussians[instance] : instance];
            hit = reaches(mine.splat(), sub_tile);
        }
        const unsigned hits = __ballot_sync(~0u, hit);
        if (hit) batch[__popc(hits & ((1u << lane) - 1))] = mine;
        __syncwarp();
        for (int k = 0, count = __popc(hits); k < count; ++k) {
            const Vec3<float> color = batch[k].color();
            pass_median<float, float>(p, fragment_alpha(batch[k].shape(), px, py).alpha, color.x, color.y, color.z,
                                      image.cutoffs);
        }
        __syncwarp();
    }
    if (!inside) return;
    const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
    image.rgb[i] = p.r, image.rgb[i + plane] = p.g, image.rgb[i + 2 * plane] = p.b;
}

}  // namespace

void write_medians(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, cudaStream_t stream) {
    find_medians<<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image);
    GS_CUDA_LAUNCHED("find_medians");
}

}  // namespace gs
