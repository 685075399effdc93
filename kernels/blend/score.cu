// SPDX-License-Identifier: Apache-2.0
// Finds the medians of pixels and scores Gaussians on the device. Both process the lists of the forward pass again:
// frames without medians have no extra cost, and a fragment's score needs the final colour of its pixel.
#include <type_traits>

#include "kernels/blend/blend_cuda.h"
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

struct NoRays {};
template <bool kLens> using Rays = std::conditional_t<kLens, TileRays, NoRays>;

/// Splats of a warp's batch that reach its sub-tile.
template <bool kLens> struct WarpBatch {
    PackedSplat splats[32];

    __device__ void put(int place, PackedSplat s, const BlendImage& image, std::uint32_t gaussian) {
        if constexpr (kLens) s.set_lens_shape(image.lens_shapes[gaussian]);
        splats[place] = s;
    }
    /// Returns alpha of the k-th splat at a pixel.
    __device__ float alpha(int k, int2 pixel, const Rays<kLens>& rays) const {
        const FragmentShape<float> s = splats[k].shape();
        if constexpr (kLens) {
            const LensShape<float> shape = splats[k].lens_shape();
            return lens_fragment_alpha<float>(shape, s.opacity, rays.of(shape.axis)).alpha;
        } else {
            return fragment_alpha(s, pixel.x + 0.5f, pixel.y + 0.5f).alpha;
        }
    }
};

/// Writes the medians of a tile. A warp processes the list for a sub-tile until all its pixels have a median.
template <bool kLens>
__global__ void __launch_bounds__(kCudaTilePixels)
    find_medians(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image) {
    __shared__ WarpBatch<kLens> batches[kSubTiles];
    __shared__ Rays<kLens> rays;
    const int tile = int(blockIdx.x), warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 sub_tile = sub_tile_corner(tile_corner(tile, bins.tiles_x), warp), pixel = pixel_of(sub_tile, lane);
    const bool inside = pixel.x < image.width && pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    WarpBatch<kLens>& batch = batches[warp];
    if constexpr (kLens) rays.find(image, pixel);
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    for (std::uint32_t base = begin; base < end; base += 32) {
        if (__all_sync(~0u, p.t <= float(kMedianTransmittance))) break;
        PackedSplat mine{};
        std::uint32_t gaussian = 0;
        bool hit = false;
        if (base + lane < end) {
            const std::uint32_t instance = bins.instances[base + lane];
            gaussian = bins.gaussians ? bins.gaussians[instance] : instance;
            mine = splats[gaussian];
            mine.a.x = image.near_x(mine.a.x, sub_tile.x);
            hit = reaches(mine.splat(), sub_tile);
        }
        const unsigned hits = __ballot_sync(~0u, hit);
        if (hit) batch.put(__popc(hits & ((1u << lane) - 1)), mine, image, gaussian);
        __syncwarp();
        for (int k = 0, count = __popc(hits); k < count; ++k) {
            const Vec3<float> color = batch.splats[k].color();
            pass_median<float, float>(p, batch.alpha(k, pixel, rays), color.x, color.y, color.z, image.cutoffs);
        }
        __syncwarp();
    }
    if (!inside) return;
    const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
    image.rgb[i] = p.r, image.rgb[i + plane] = p.g, image.rgb[i + 2 * plane] = p.b;
}

/// Sums the scores of each sub-tile with one warp, which processes the whole list. `out` is (Gaussians), or (slots,
/// sub-tiles) with a fixed order.
template <bool kFixedOrder, bool kLens>
__global__ void __launch_bounds__(kCudaTilePixels)
    score_tiles(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image, float* __restrict__ out) {
    __shared__ WarpBatch<kLens> batches[kSubTiles];
    __shared__ Rays<kLens> rays;
    __shared__ std::uint32_t all_targets[kSubTiles][32];
    if (!bins.longest_first[blockIdx.x].is_first_of_tile()) return;
    const int tile = bins.longest_first[blockIdx.x].tile(), warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 sub_tile = sub_tile_corner(tile_corner(tile, bins.tiles_x), warp), pixel = pixel_of(sub_tile, lane);
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    WarpBatch<kLens>& batch = batches[warp];
    if constexpr (kLens) rays.find(image, pixel);
    std::uint32_t* targets = all_targets[warp];
    PixelScore<float> p{};  // pixels outside the image have no transmittance left
    if (pixel.x < image.width && pixel.y < image.height) {
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x,
                          plane = std::size_t(image.width) * image.height;
        p = PixelScore<float>::of(Vec3<float>{image.rgb[i], image.rgb[i + plane], image.rgb[i + 2 * plane]},
                                  image.transmittance[i], image.background);
    }
    for (std::uint32_t base = begin; base < end; base += 32) {
        if (__all_sync(~0u, p.t < image.cutoffs.transmittance)) break;
        PackedSplat mine{};
        std::uint32_t instance = 0, gaussian = 0;
        bool hit = false;
        if (base + lane < end) {
            instance = bins.instances[base + lane];
            gaussian = kFixedOrder ? bins.gaussians[instance] : instance;
            mine = splats[gaussian];
            mine.a.x = image.near_x(mine.a.x, sub_tile.x);
            hit = reaches(mine.splat(), sub_tile);
        }
        const unsigned hits = __ballot_sync(~0u, hit);
        const int place = __popc(hits & ((1u << lane) - 1)), count = __popc(hits);
        if (hit) batch.put(place, mine, image, gaussian), targets[place] = instance;
        __syncwarp();
        float of_lane = 0;  // sum of the lane-th splat
        for (int k = 0; k < count; ++k) {
            const Vec3<float> color = batch.splats[k].color();
            const float sum =
                warp_sum(fragment_score<float, float>(p, batch.alpha(k, pixel, rays), batch.splats[k].shape().opacity,
                                                      color.x + color.y + color.z, image.cutoffs));
            if (lane == k) of_lane = sum;
        }
        if (lane < count) {
            if (kFixedOrder)
                out[std::size_t(targets[lane]) * kSubTiles + warp] = of_lane;
            else if (of_lane > 0)
                atomicAdd(&out[targets[lane]], of_lane);
        }
        __syncwarp();
    }
}

/// Adds up the instances of a Gaussian in order, and the sub-tiles of each in order; one thread per Gaussian.
__global__ void add_partial_scores(std::int64_t n, SlotMap slots, const float* __restrict__ partial,
                                   float* __restrict__ scores) {
    const std::int64_t k = std::int64_t(blockIdx.x) * 256 + threadIdx.x;
    if (k >= n) return;
    const std::size_t begin = k ? slots.slot_ends[k - 1] : 0, end = slots.slot_ends[k];
    if (begin == end) return;
    float sum = 0;
    for (std::size_t i = begin * kSubTiles; i < end * kSubTiles; ++i) sum += partial[i];
    scores[slots.order[k]] += sum;
}

}  // namespace

void write_medians(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, cudaStream_t stream) {
    const auto find = image.rays ? &find_medians<true> : &find_medians<false>;
    find<<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image);
    GS_CUDA_LAUNCHED("find_medians");
}

CudaScores::CudaScores(std::int64_t n, cudaStream_t stream) : n_(n), stream_(stream) {
    if (n > 0) GS_CUDA(cudaMemsetAsync(scores_.reserve(n), 0, n * sizeof(float), stream));
}

void CudaScores::add(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, const SlotMap* slots,
                     std::int64_t num_instances) {
    if (num_instances == 0) return;
    if (!slots) {
        const auto score = image.rays ? &score_tiles<false, true> : &score_tiles<false, false>;
        score<<<bins.num_items(), kCudaTilePixels, 0, stream_>>>(bins, splats, image, scores_.get());
        GS_CUDA_LAUNCHED("score_tiles");
        return;
    }
    const std::size_t sums = std::size_t(num_instances) * kSubTiles;
    GS_CUDA(cudaMemsetAsync(partial_.reserve(sums), 0, sums * sizeof(float), stream_));
    const auto score = image.rays ? &score_tiles<true, true> : &score_tiles<true, false>;
    score<<<bins.num_items(), kCudaTilePixels, 0, stream_>>>(bins, splats, image, partial_.get());
    GS_CUDA_LAUNCHED("score_tiles");
    add_partial_scores<<<num_blocks(n_, 256), 256, 0, stream_>>>(n_, *slots, partial_.get(), scores_.get());
    GS_CUDA_LAUNCHED("add_partial_scores");
}

std::vector<float> CudaScores::download() const {
    GS_CUDA(cudaStreamSynchronize(stream_));
    return scores_.download(n_);
}

}  // namespace gs
