// SPDX-License-Identifier: Apache-2.0
// The backward pass of the blend, with one warp per chunk and pair of sub-tiles.
//
// A warp processes 16 splats at a time. A lane has a column of four pixels and four consecutive splats; a column's
// four lanes cover all 16. Each lane gets from the others the transmittance before its first splat and the light from
// behind it, and then works independently. It adds up its fragments by column, and the eight columns are summed through
// shared memory. With one lane per pixel, all 32 lanes would read every splat, and would have to sum nine values of
// each: the path to shared memory would be the bottleneck.
//
// Two lanes share the fetch of a splat and the addition of its sums, so that one memory request moves both halves.
// While a batch of splats is processed, the next one loads.
#include <algorithm>
#include <type_traits>

#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

constexpr int kBatch = 16;        ///< splats that a warp processes at a time
constexpr int kOwn = 4;           ///< splats of a lane; the four lanes of a column cover a whole batch
constexpr int kWarps = 2;         ///< warps of a block, which share nothing
constexpr int kBlocksAtOnce = 8;  ///< blocks per multiprocessor
constexpr std::uint32_t kNobody = ~0u;

/// The shared memory of one warp. The strides put values that eight lanes access together into different banks.
struct WarpMemory {
    static constexpr int kSplatStride = 3 * kOwn + 2, kSumStride = kSubX + 1;

    float4 pixels[kSubY][kSubX];                ///< dL/dpixel, and its part from the background
    float4 batch[kBatch / kOwn][kSplatStride];  ///< consecutive splats of a lane, in the layout of PackedSplat
    float4 sums[2 * kBatch][kSumStride];        ///< sums by half splat, in the order of HalfOfLane, and by column
    std::uint32_t list[kChunk];                 ///< instances that changed a pixel of the sub-tile
};

/// The rays of a sub-tile's pixels through a lens, in the axes of the faces.
struct LensMemory {
    float4 xy[kFaceAxes][kSubY / 2][kSubX];  ///< two pixels of a column at a time
    float4 w[kFaceAxes][kSubX];              ///< a column
    static_assert(kSubY == 4);

    /// Returns the axis of the face that the ray of the first pixel passes: that of most splats of the sub-tile.
    __device__ int find(const BlendImage& image, int2 corner, int lane) {
        const int x = lane % kSubX, y = lane / kSubX;
        return image.face_rays(pixel_of(corner, lane), [&](int axis, const FaceRay<float>& ray) {
            reinterpret_cast<float2*>(&xy[axis][y / 2][x])[y % 2] = make_float2(ray.x, ray.y);
            (&w[axis][x].x)[y] = ray.w;
        });
    }
};
struct NoLensMemory {};
template <class Lens> inline constexpr bool kIsLens = std::is_same_v<Lens, LensMemory>;

/// The rays of a lane's column of pixels in the axes of a face.
struct ColumnRays {
    FaceRay<float> of[kSubY];

    __device__ ColumnRays(const LensMemory& lens, int axis, int column) {
        const float4 top = lens.xy[axis][0][column], low = lens.xy[axis][1][column], w = lens.w[axis][column];
        of[0] = {top.x, top.y, w.x}, of[1] = {top.z, top.w, w.y};
        of[2] = {low.x, low.y, w.z}, of[3] = {low.z, low.w, w.w};
    }
};

/// The rays of a lane's column for each of a batch's splats: of any splats, of splats that all have the usual axis and
/// are not wide, and none without a lens.
struct RaysOfAny {
    const LensMemory& lens;
    int column;

    __device__ ColumnRays operator()(LensWord splat) const { return {lens, splat.axis(), column}; }
    __device__ LensShape<float> known(const LensShape<float>& s) const { return s; }
};
struct RaysOfUsual {
    ColumnRays rays;

    __device__ const ColumnRays& operator()(LensWord) const { return rays; }
    __device__ LensShape<float> known(const LensShape<float>& s) const { return narrow(s); }
};
struct NoRays {};

/// The work of a lane: fragments of a column of pixels and of a group of splats. Lanes that differ only in the lowest
/// bit have the same group, and lanes that differ only in the next bit have the same column, so that shared memory
/// serves a warp's reads of either at once.
struct LaneOf {
    int column, group;

    __device__ explicit LaneOf(int lane) : column(lane / 8 * 2 + lane % 2), group(lane / 2 % 4) {}
};

/// The half of a splat that a lane fetches, and to whose sums it adds.
struct HalfOfLane {
    int group, own;  ///< the own-th splat of the group
    bool second;

    __device__ explicit HalfOfLane(int lane) : group(LaneOf(lane).group), own(lane / 8), second(lane % 2) {}
    __device__ int row() const { return group * kOwn + own; }
};

__device__ void add(float4* to, float4 x) {
#if __CUDA_ARCH__ >= 900
    atomicAdd(to, x);
#else
    atomicAdd(&to->x, x.x), atomicAdd(&to->y, x.y), atomicAdd(&to->z, x.z), atomicAdd(&to->w, x.w);
#endif
}

/// The part of a splat that one of two lanes fetches: a or b, which are adjacent in memory, and green or blue, which
/// are adjacent, too.
template <bool kLens> struct HalfSplat {
    float4 shape{};
    float color = 0;
    float2 rest{};  ///< c.z and c.w, in the second half

    HalfSplat() = default;  ///< half of a splat that changes nothing
    __device__ HalfSplat(const PackedSplat& from, int half) : shape((&from.a)[half]), color((&from.c.x)[half]) {}
    /// As PackedSplat::set_lens_shape().
    __device__ HalfSplat(const PackedSplat& from, const PackedLensShape& lens, int half) : HalfSplat(from, half) {
        const float4 of_lens = (&lens.a)[half];
        if (half)
            shape.x = of_lens.x, shape.z = of_lens.z, rest = make_float2(of_lens.w, of_lens.y);
        else
            shape = of_lens;
    }
    __device__ void store(float4* to, int half) const {
        to[half] = shape, (&to[2].x)[half] = color;
        if (kLens && half) to[2].z = rest.x, to[2].w = rest.y;
    }
    /// As LensWord::differs_from(), in the second half.
    __device__ unsigned differs_from(int axis) const { return LensWord{__float_as_uint(rest.y)}.differs_from(axis); }
};

/// Values of the lanes in a column, combined over the lanes before this one, and over all four.
struct OfColumn {
    float before, all;
};
__device__ OfColumn product_of_column(float x) {
    const float other = __shfl_xor_sync(~0u, x, 2), pair = x * other, other_pair = __shfl_xor_sync(~0u, pair, 4);
    return {(threadIdx.x & 2 ? other : 1.0f) * (threadIdx.x & 4 ? other_pair : 1.0f), pair * other_pair};
}
__device__ OfColumn sum_of_column(float x) {
    const float other = __shfl_xor_sync(~0u, x, 2), pair = x + other, other_pair = __shfl_xor_sync(~0u, pair, 4);
    return {(threadIdx.x & 2 ? other : 0.0f) + (threadIdx.x & 4 ? other_pair : 0.0f), pair + other_pair};
}

/// Converts alpha and dL/dpixel . colour of a lane's four fragments of a pixel to the factors h and w of their
/// gradients (FragmentGradient). `t` is the transmittance before the first fragment. `behind` is the value of the pixel
/// before the batch, and is updated to the value after it. With kEnds the pixel may be finished within the batch.
template <bool kEnds>
__device__ void pass_fragments(float (&alpha)[kOwn], float (&slope)[kOwn], float t, float& behind, float background,
                               const Cutoffs<float>& cutoffs) {
    float colors = 0, left[kOwn];
    PassedFragment<float> passed[kOwn];
#pragma unroll
    for (int i = 0; i < kOwn; ++i) {
        if (kEnds) alpha[i] = t >= cutoffs.transmittance ? alpha[i] : 0;
        const float w = t * alpha[i];
        passed[i] = {alpha[i], w, w * slope[i], inverse_passed<float, float>(alpha[i])};
        left[i] = t -= w;
        colors += passed[i].color;
    }
    const OfColumn light = sum_of_column(colors);
    float rest = behind - light.before;
    behind -= light.all;
#pragma unroll
    for (int i = 0; i < kOwn; ++i) {
        rest -= passed[i].color;
        if (kEnds) rest = left[i] >= cutoffs.transmittance ? rest : background;  // as in pass_fragment()
        alpha[i] = shape_factor(passed[i], rest), slope[i] = passed[i].w;
    }
}

/// Returns the sum over the columns of a value per splat of a lane, for the splat of HalfOfLane.
__device__ float sum_over_columns(const float (&x)[kOwn], int lane) {
    const bool upper = lane & 16, middle = lane & 8;
    float low = upper ? x[2] : x[0], high = upper ? x[3] : x[1];
    low += __shfl_xor_sync(~0u, upper ? x[0] : x[2], 16);
    high += __shfl_xor_sync(~0u, upper ? x[1] : x[3], 16);
    float sum = middle ? high : low;
    sum += __shfl_xor_sync(~0u, middle ? low : high, 8);
    return sum + __shfl_xor_sync(~0u, sum, 1);
}

/// Adds the gradients of a batch to its splats. `h` and `w` belong to a lane's fragments, by pixel and splat.
/// `first_pixel` is that of the lane. `target` belongs to the splat that this lane shares with its neighbour.
template <bool kFixedOrder, class RaysOf>
__device__ void add_gradients(WarpMemory& memory, const RaysOf& rays_of, const float (&h)[kSubY][kOwn],
                              const float (&w)[kSubY][kOwn], int2 first_pixel, std::uint32_t target, int sub_tile,
                              int lane, PackedSums* __restrict__ sums) {
    const float px = first_pixel.x + 0.5f, centre_y = first_pixel.y + 0.5f * kSubY;
    const auto [column, group] = LaneOf(lane);
    float blue[kOwn];
#pragma unroll
    for (int i = 0; i < kOwn; ++i) {
        // Moments of h about the middle of the sub-tile's height, with rows at -1.5, -0.5, 0.5 and 1.5.
        const float outer = h[0][i] + h[3][i], inner = h[1][i] + h[2][i], m0 = outer + inner,
                    m1 = 1.5f * (h[3][i] - h[0][i]) + 0.5f * (h[2][i] - h[1][i]), m2 = 2.25f * outer + 0.25f * inner;
        float red = 0, green = 0;
        blue[i] = 0;
#pragma unroll
        for (int y = 0; y < kSubY; ++y) {
            const float4 g = memory.pixels[y][column];
            red = gs_fma(w[y][i], g.x, red), green = gs_fma(w[y][i], g.y, green);
            blue[i] = gs_fma(w[y][i], g.z, blue[i]);
        }
        const int half_splat = 8 * i + 2 * group;
        const float2 mean = *reinterpret_cast<const float2*>(&memory.batch[group][3 * i]);
        if constexpr (!std::is_same_v<RaysOf, NoRays>) {
            const ColumnRays& rays = rays_of(PackedSplat{{}, {}, memory.batch[group][3 * i + 2]}.lens_word());
            SplatSums<float> s{};
#pragma unroll
            for (int y = 0; y < kSubY; ++y) {
                const FaceRay<float>& ray = rays.of[y];
                const Vec2<float> d = lens_offset(mean.x, mean.y, ray);
                const float hx = h[y][i] * d.x, hy = h[y][i] * d.y;
                s.hx = gs_fma(hx, ray.w, s.hx), s.hy = gs_fma(hy, ray.w, s.hy);
                s.hxx = gs_fma(hx, d.x, s.hxx), s.hxy = gs_fma(hx, d.y, s.hxy), s.hyy = gs_fma(hy, d.y, s.hyy);
            }
            memory.sums[half_splat][column] = make_float4(m0, s.hx, s.hy, s.hxx);
            memory.sums[half_splat + 1][column] = make_float4(s.hxy, s.hyy, red, green);
            continue;
        }
        const float dx = mean.x - px, dy = mean.y - centre_y, hx = dx * m0, hy = dy * m0 - m1;
        memory.sums[half_splat][column] = make_float4(m0, hx, hy, dx * hx);
        memory.sums[half_splat + 1][column] = make_float4(dx * hy, dy * (hy - m1) + m2, red, green);
    }
    const float own_blue = sum_over_columns(blue, lane);
    __syncwarp();
    const HalfOfLane half(lane);
    const float4* const columns = memory.sums[lane];
    float4 own = columns[0];
#pragma unroll
    for (int k = 1; k < kSubX; ++k)
        own.x += columns[k].x, own.y += columns[k].y, own.z += columns[k].z, own.w += columns[k].w;
    if (target == kNobody) return;
    PackedSums* to = sums + (kFixedOrder ? std::size_t(target) * kSubTiles + sub_tile : target);
    float4* const place = &to->a + half.second;
    if (kFixedOrder) {
        *place = own;
        if (half.second) to->c.x = own_blue;
    } else {
        add(place, own);
        if (half.second) atomicAdd(&to->c.x, own_blue);
    }
}

/// A pixel in the final state of the forward pass, and its gradient. Both are 0 outside the image.
struct PixelToPass {
    bool inside;
    float r = 0, g = 0, b = 0, transmittance = 0;  ///< the pixel
    float dr = 0, dg = 0, db = 0;                  ///< dL/dpixel

    __device__ PixelToPass(int2 pixel, const BlendImage& image, const float* __restrict__ dL_dimage)
        : inside(pixel.x < image.width && pixel.y < image.height) {
        if (!inside) return;
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x,
                          plane = std::size_t(image.width) * image.height;
        r = image.rgb[i], g = image.rgb[i + plane], b = image.rgb[i + 2 * plane],
        transmittance = image.transmittance[i];
        dr = dL_dimage[i], dg = dL_dimage[i + plane], db = dL_dimage[i + 2 * plane];
    }
    /// Returns dL/dpixel, and its part from the background.
    __device__ float4 gradient(const Vec3<float>& bg) const {
        return make_float4(dr, dg, db, transmittance * (dr * bg.x + dg * bg.y + db * bg.z));
    }
    /// Returns the transmittance, and dL/dpixel . (light from behind). `before` holds colour and transmittance before
    /// the chunk.
    __device__ float2 state(const float4& before) const {
        return make_float2(before.w, (r - before.x) * dr + (g - before.y) * dg + (b - before.z) * db);
    }
};

/// Processes the part `chunk` of a tile's list for one sub-tile.
template <bool kFixedOrder, class Lens>
__device__ void walk_chunk(WarpMemory& memory, Lens& lens, const BlendChunk& chunk, int sub_tile, const CudaBins& bins,
                           const PackedSplat* __restrict__ splats, const BlendImage& image,
                           const float* __restrict__ dL_dimage, const BlendTrail& trail, std::uint32_t num_instances,
                           PackedSums* __restrict__ sums) {
    constexpr bool kLens = kIsLens<Lens>;
    const int lane = threadIdx.x & 31;
    const int2 corner = sub_tile_corner({int(chunk.corner & 0xffff), int(chunk.corner >> 16)}, sub_tile);
    // These reads depend on nothing else, and are issued together.
    const std::uint32_t processed = trail.processed[chunk.tile * kSubTiles + sub_tile];
    const std::uint32_t* hits =
        trail.hits + ((first_group(chunk.tile, chunk.tile_begin) + chunk.first / 32) * kSubTiles + sub_tile);
    unsigned word_of_lane = lane < kChunk / 32 ? hits[lane * kSubTiles] : 0;
    std::uint32_t instances[kChunk / 32];
#pragma unroll
    for (int k = 0; k < kChunk / 32; ++k) {
        const std::uint32_t at = chunk.tile_begin + chunk.first + k * 32 + lane;
        instances[k] = at < num_instances ? bins.instances[at] : 0;
    }
    const PixelToPass of_lane(pixel_of(corner, lane), image, dL_dimage);
    // Once all of its pixels are finished, a sub-tile has neither lists nor states.
    const int count = min(int(processed) - int(chunk.first), kChunk);
    if (count <= 0) return;
    if (lane * 32 >= count) word_of_lane = 0;
    float4 before_chunk = make_float4(0, 0, 0, of_lane.inside ? 1 : 0);
    if (of_lane.inside && chunk.first) {
        const std::size_t checkpoint = checkpoint_before(chunk.tile_begin, chunk.first);
        before_chunk = trail.checkpoints[checkpoint * kCudaTilePixels + sub_tile * 32 + lane];
    }
    int listed = 0;
#pragma unroll
    for (int group = 0; group < kChunk / 32; ++group) {
        const unsigned word = __shfl_sync(~0u, word_of_lane, group);
        if (word >> lane & 1) memory.list[listed + __popc(word & ((1u << lane) - 1))] = instances[group];
        listed += __popc(word);
    }
    if (listed == 0) return;
    __syncwarp();
    // Returns the instance of this lane's splat in the batch that begins at `first`, and the splat.
    const HalfOfLane half(lane);
    const auto target_from = [&](int first) {
        const int k = first + half.row();
        return k < listed ? memory.list[k] : kNobody;
    };
    const auto fetch = [&](std::uint32_t target) {
        if (target == kNobody) return HalfSplat<kLens>{};
        const std::uint32_t gaussian = kFixedOrder ? bins.gaussians[target] : target;
        if constexpr (kLens) return HalfSplat<kLens>(splats[gaussian], image.lens_shapes[gaussian], half.second);
        return HalfSplat<kLens>(splats[gaussian], half.second);
    };
    std::uint32_t target = target_from(0);
    HalfSplat<kLens> splat = fetch(target);
    const auto [column, group] = LaneOf(lane);
    const int2 first_pixel{corner.x + column, corner.y};
    int usual_axis = 0;
    if constexpr (kLens) usual_axis = lens.find(image, corner, lane);
    float t[kSubY], behind[kSubY];
    // Lanes have loaded neighbouring pixels, and read the pixels of their columns from shared memory.
    float2* const states = reinterpret_cast<float2*>(memory.sums);
    states[lane] = of_lane.state(before_chunk);
    memory.pixels[lane / kSubX][lane % kSubX] = of_lane.gradient(image.background);
    __syncwarp();
#pragma unroll
    for (int y = 0; y < kSubY; ++y) t[y] = states[y * kSubX + column].x, behind[y] = states[y * kSubX + column].y;
    // A finished pixel has no transmittance left, and no light from behind.
    const auto finish = [&](int y) {
        if (t[y] < image.cutoffs.transmittance) t[y] = behind[y] = 0;
    };
#pragma unroll
    for (int y = 0; y < kSubY; ++y) finish(y);
    for (int first = 0; first < listed; first += kBatch) {
        const bool differs =
            kLens && __any_sync(~0u, half.second && target != kNobody && splat.differs_from(usual_axis));
        const auto with_rays = [&](auto&& f) {
            if constexpr (!kLens)
                f(NoRays{});
            else if (differs)
                f(RaysOfAny{lens, column});
            else
                f(RaysOfUsual{{lens, usual_axis, column}});
        };
        splat.store(&memory.batch[half.group][3 * half.own], half.second);
        __syncwarp();
        const std::uint32_t next = target_from(first + kBatch);
        splat = fetch(next);  // loads while this batch is processed

        float alpha[kSubY][kOwn], slope[kSubY][kOwn];  // later h and w
        with_rays([&](const auto& rays_of) {
#pragma unroll
            for (int i = 0; i < kOwn; ++i) {
                const float4* const s = &memory.batch[group][3 * i];
                const float4 a = s[0], b = s[1];
                const float2 c = *reinterpret_cast<const float2*>(&s[2]);
                float of_pixels[kSubY];
                if constexpr (kLens) {
                    const PackedSplat packed{a, b, s[2]};
                    const LensShape<float> shape = rays_of.known(packed.lens_shape());
                    const ColumnRays& rays = rays_of(packed.lens_word());
#pragma unroll
                    for (int y = 0; y < kSubY; ++y)
                        of_pixels[y] = lens_fragment_alpha<float>(shape, b.y, rays.of[y]).alpha;
                } else {
#pragma unroll
                    for (int y = 0; y < kSubY; ++y)
                        of_pixels[y] = fragment_alpha(FragmentShape<float>{a.x, a.y, a.z, a.w, b.x, b.y},
                                                      first_pixel.x + 0.5f, first_pixel.y + y + 0.5f)
                                           .alpha;
                }
#pragma unroll
                for (int y = 0; y < kSubY; ++y) {
                    const float4 g = memory.pixels[y][column];
                    const float of_pixel = of_pixels[y];
                    alpha[y][i] = of_pixel >= image.cutoffs.alpha ? of_pixel : 0;
                    slope[y][i] = color_gradient(PixelBackward<float>{.gr = g.x, .gg = g.y, .gb = g.z}, b.w, c.x, c.y);
                }
            }
        });
        float before[kSubY];  // transmittance before this lane's splats
        bool ends = false;
#pragma unroll
        for (int y = 0; y < kSubY; ++y) {
            float through = 1 - alpha[y][0];
#pragma unroll
            for (int i = 1; i < kOwn; ++i) through *= 1 - alpha[y][i];
            const OfColumn light = product_of_column(through);
            before[y] = t[y] * light.before;
            const float after_all = t[y] * light.all;
            ends |= t[y] > 0 && after_all < image.cutoffs.transmittance;
            t[y] = after_all;
        }
        const auto pass = [&](auto may_end) {
#pragma unroll
            for (int y = 0; y < kSubY; ++y)
                pass_fragments<may_end>(alpha[y], slope[y], before[y], behind[y], memory.pixels[y][column].w,
                                        image.cutoffs);
        };
        if (__any_sync(~0u, ends)) {
            pass(std::true_type{});
#pragma unroll
            for (int y = 0; y < kSubY; ++y) finish(y);
        } else {
            pass(std::false_type{});
        }
        with_rays([&](const auto& rays_of) {
            add_gradients<kFixedOrder>(memory, rays_of, alpha, slope, first_pixel, target, sub_tile, lane, sums);
        });
        target = next;
    }
    __syncwarp();  // before the next chunk overwrites data that slower lanes may still read
}

/// Processes chunks: each warp takes the next chunk and two of its sub-tiles when it is done with the previous one.
/// With one block per item a fifth of the warp slots would be empty, since blocks of a few thousand cycles end and
/// begin all the time.
template <bool kFixedOrder, class Lens>
__global__ void __launch_bounds__(32 * kWarps, kBlocksAtOnce)
    blend_backward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image,
                   const float* __restrict__ dL_dimage, const StepControl* __restrict__ control, BlendTrail trail,
                   PackedSums* __restrict__ sums) {
    __shared__ WarpMemory memories[kWarps];
    __shared__ Lens lenses[kWarps];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const unsigned num_items = control->num_chunks * (kSubTiles / 2);
    const auto take = [&] { return lane == 0 ? atomicAdd(trail.next_item, 1u) : 0; };
    // Each lane reads one of the four words of the next chunk.
    const auto word_of = [&](unsigned item) {
        const auto* const chunks = reinterpret_cast<const std::uint32_t*>(trail.chunks);
        return item < num_items ? chunks[item / (kSubTiles / 2) * 4 + lane % 4] : 0;
    };
    unsigned item = __shfl_sync(~0u, take(), 0);
    std::uint32_t word = word_of(item);
    while (item < num_items) {
        const BlendChunk chunk{__shfl_sync(~0u, word, 0), __shfl_sync(~0u, word, 1), __shfl_sync(~0u, word, 2),
                               __shfl_sync(~0u, word, 3)};
        const int first = int(item % (kSubTiles / 2)) * 2;
        const unsigned next = take();  // loads during the first sub-tile, and its chunk during the second
#pragma unroll 1
        for (int k = 0; k < 2; ++k) {
            walk_chunk<kFixedOrder>(memories[warp], lenses[warp], chunk, first + k, bins, splats, image, dL_dimage,
                                    trail, std::uint32_t(control->num_instances), sums);
            if (k == 0) item = __shfl_sync(~0u, next, 0), word = word_of(item);
        }
    }
}

/// Adds up the instances of a Gaussian in order, and the sub-tiles of each in order; one thread per Gaussian.
__global__ void add_partial_sums(std::int64_t n, SlotMap slots, const StepControl* __restrict__ control,
                                 const PackedSums* __restrict__ partial, PackedSums* __restrict__ sums) {
    const std::int64_t k = std::int64_t(blockIdx.x) * 256 + threadIdx.x;
    if (k >= n || control->stopped) return;  // slots beyond the capacity do not exist
    const std::size_t begin = k ? slots.slot_ends[k - 1] : 0, end = slots.slot_ends[k];
    PackedSums s{};
    for (std::size_t i = begin * kSubTiles; i < end * kSubTiles; ++i) {
        const PackedSums p = partial[i];
        s.a.x += p.a.x, s.a.y += p.a.y, s.a.z += p.a.z, s.a.w += p.a.w;
        s.b.x += p.b.x, s.b.y += p.b.y, s.b.z += p.b.z, s.b.w += p.b.w;
        s.c.x += p.c.x;
    }
    if (begin < end) sums[slots.order[k]] = s;
}

/// Returns the number of multiprocessors of the current device.
unsigned num_multiprocessors() {
    int device = 0, n = 0;
    GS_CUDA(cudaGetDevice(&device));
    GS_CUDA(cudaDeviceGetAttribute(&n, cudaDevAttrMultiProcessorCount, device));
    return unsigned(n);
}

}  // namespace

void CudaBlend::take_partial_sums(Carver& c, std::int64_t capacity) {
    partial_ = c.take<PackedSums>(std::size_t(capacity) * kSubTiles);
}

void CudaBlend::backward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image,
                         const BlendGradients& gradients, const StepControl* control, cudaStream_t stream) {
    const unsigned blocks = std::min(num_blocks((capacity_ / kChunk + bins.num_tiles()) * kSubTiles / 2, kWarps),
                                     num_multiprocessors() * kBlocksAtOnce);
    const auto [dL_dimage, sums, n, slots] = gradients;
    if (!slots) {
        const auto kernel = image.rays ? &blend_backward<false, LensMemory> : &blend_backward<false, NoLensMemory>;
        kernel<<<blocks, 32 * kWarps, 0, stream>>>(bins, splats, image, dL_dimage, control, trail_, sums);
        GS_CUDA_LAUNCHED("blend_backward");
        return;
    }
    GS_CUDA(cudaMemsetAsync(partial_, 0, std::size_t(capacity_) * kSubTiles * sizeof(PackedSums), stream));
    const auto kernel = image.rays ? &blend_backward<true, LensMemory> : &blend_backward<true, NoLensMemory>;
    kernel<<<blocks, 32 * kWarps, 0, stream>>>(bins, splats, image, dL_dimage, control, trail_, partial_);
    GS_CUDA_LAUNCHED("blend_backward");
    if (n == 0) return;
    add_partial_sums<<<num_blocks(n, 256), 256, 0, stream>>>(n, *slots, control, partial_, sums);
    GS_CUDA_LAUNCHED("add_partial_sums");
}

void CudaBlend::begin_again(cudaStream_t stream) {
    GS_CUDA(cudaMemsetAsync(trail_.next_item, 0, sizeof *trail_.next_item, stream));
    if (trail_.num_zeros > 0)
        GS_CUDA(cudaMemsetAsync(trail_.zeros, 0, trail_.num_zeros * sizeof *trail_.zeros, stream));
}

}  // namespace gs
