// SPDX-License-Identifier: Apache-2.0
// Blending on the device: forward per pixel (docs/math/rasterizer.md#blending), backward per chunk of a tile's list
// (docs/math/rasterizer.md#blend-gradient).
//
// A warp owns a sub-tile, which is 8x4 pixels of a tile, or a quarter of a sub-tile in tiles with long lists. The
// forward pass tests each splat against all sub-tiles of a tile, and records which splats changed a pixel of which
// sub-tile; the backward pass visits only these. The backward pass cuts a long list into chunks. Each chunk starts from
// the state that the forward pass saved there.
#pragma once

#include <span>
#include <vector>

#include "kernels/blend/blend_device.h"
#include "kernels/blend/residual_score.h"
#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"
#include "kernels/splat/gaussian_rows_device.h"
#include "kernels/splat/splat_cuda.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// Number of instances of a tile between two saved states. It is small enough to spread the backward pass of the
/// longest list over the device, and large enough for the states (16 bytes a pixel) to take little memory.
inline constexpr int kChunk = 192;
inline constexpr int kSubX = 8, kSubY = 4, kSubTiles = kCudaTilePixels / 32;

/// The sums of one Gaussian over all pixels, in three 16-byte groups so that the device adds them with three atomics.
struct alignas(16) PackedSums {
    float4 a;  ///< h, hx, hy, hxx
    float4 b;  ///< hxy, hyy, r, g
    float4 c;  ///< b, unused

    __device__ SplatSums<float> sums() const { return {a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x}; }
};

/// A part of a tile's list. One warp processes it for two of the tile's sub-tiles, one after the other.
struct alignas(16) BlendChunk {
    std::uint32_t tile, tile_begin;  ///< the tile, and the first instance of its list
    std::uint32_t first;             ///< instances first .. first+kChunk of the tile
    std::uint32_t corner;            ///< the tile's first pixel: x | y << 16
};

/// Data of the forward pass that the backward pass needs.
struct BlendTrail {
    float4* checkpoints = nullptr;  ///< (chunks except the first of each tile, 192): colour so far and transmittance
    BlendChunk* chunks = nullptr;
    std::uint32_t* hits = nullptr;       ///< bit mask per 32 instances and sub-tile: instances that changed a pixel
    std::uint32_t* processed = nullptr;  ///< by tile and sub-tile: instances until all its pixels were finished
    unsigned* next_item = nullptr;       ///< index of the backward pass's next chunk and pair of sub-tiles
    float4* zeros = nullptr;             ///< memory that the forward pass also sets to 0
    std::size_t num_zeros = 0;
};

/// Input and output gradients of the backward pass.
struct BlendGradients {
    const float* dL_dimage;  ///< (3,H,W)
    PackedSums* sums;        ///< (n)
    std::int64_t n;
    const SlotMap* slots;  ///< null: float atomics add to the sums, which must be 0 before
};

/// Output images of a blend.
struct BlendImage {
    int width, height;
    Vec3<float> background;
    float *rgb, *transmittance;  ///< (3,H,W), (H,W)
    Cutoffs<float> cutoffs;
    float period;                        ///< as in CameraParams
    const PackedLensShape* lens_shapes;  ///< (Gaussians), through a lens; else null
    const float4* rays;                  ///< (H,W) unit rays of the pixels in x, y and z, through a lens
    float face_focal;                    ///< as in CameraParams
    bool as_pinholes;                    ///< as in Lens

    /// Calls f with each axis and the ray of a pixel in the axes of its faces; 0 outside the image. Returns the axis of
    /// the face that the ray of the warp's first pixel passes.
    template <class F> __device__ int face_rays(int2 pixel, F&& f) const {
        float4 r{};
        if (pixel.x < width && pixel.y < height) r = rays[std::size_t(pixel.y) * width + pixel.x];
#pragma unroll
        for (int axis = 0; axis < kFaceAxes; ++axis)
            f(axis, face_ray(Vec3<float>{r.x, r.y, r.z}, axis, face_focal, as_pinholes));
        return __shfl_sync(~0u, axis_of(face_of(Vec3<float>{r.x, r.y, r.z})), 0);
    }
    /// Returns the place of a splat that is nearest to a tile, or part of one, if the image repeats.
    __device__ float near_x(float mean_x, int corner_x) const {
        return period > 0 ? nearest_repeat(mean_x, corner_x + 0.5f * kCudaTileX, period) : mean_x;
    }
};

/// The rays of a tile's pixels in the axes of the faces, one pixel a thread, in shared memory.
struct TileRays {
    float2 xy[kFaceAxes][kCudaTilePixels];
    float w[kFaceAxes][kCudaTilePixels];

    /// Returns the axis of the face that the ray of the warp's first pixel passes: that of most splats of the warp.
    __device__ int find(const BlendImage& image, int2 pixel) {
        return image.face_rays(pixel, [&](int axis, const FaceRay<float>& ray) {
            xy[axis][threadIdx.x] = make_float2(ray.x, ray.y), w[axis][threadIdx.x] = ray.w;
        });
    }
    __device__ FaceRay<float> of(int axis) const {
        const float2 p = xy[axis][threadIdx.x];
        return {p.x, p.y, w[axis][threadIdx.x]};
    }
};

class CudaBlend {
  public:
    /// Takes the buffers that live from the forward to the backward pass. A forward pass with a backward pass sets the
    /// first `num_sums` of `sums` to 0. They must not move until the backward pass.
    void take(Carver& c, std::int64_t capacity, int num_tiles, PackedSums* sums, std::int64_t num_sums);
    /// Takes the buffer that only the backward pass with a fixed order of sums uses.
    void take_partial_sums(Carver& c, std::int64_t capacity);

    /// Returns the memory that must be 0 before a forward pass with a backward pass: blocks that share a tile add to
    /// it.
    std::span<uint4> marks() const { return marks_; }
    /// Blends a view into `image`. With `for_backward` it keeps the lists and states for backward().
    void forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control,
                 bool for_backward, cudaStream_t stream);
    /// Adds to the sums. The order of float atomics varies from run to run. With slots, sums are written instead, each
    /// added up in the order of its instances; the sums of invisible Gaussians are left unchanged.
    void backward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image,
                  const BlendGradients& gradients, const StepControl* control, cudaStream_t stream);
    /// Prepares another backward pass of the same forward pass: resets the sums and the work counter to 0.
    void begin_again(cudaStream_t stream);

  private:
    std::int64_t capacity_ = 0;
    std::span<uint4> marks_;  ///< hits, followed by the counts of processed instances
    BlendTrail trail_;
    PackedSums* partial_ = nullptr;  ///< (slots, sub-tiles)
};

// The medians of a view's pixels on the device (docs/math/rasterizer.md#median).

/// Replaces the colours of a view blended into `image` by the median colours of the pixels; 0 if transmittance stays
/// above 1/2.
void write_medians(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, cudaStream_t stream);

// The scores of all Gaussians on the device, gathered view by view (docs/math/densification.md#pruning-by-score).

/// The scores of n Gaussians. Holds 4 bytes per Gaussian while it lives, plus 24 bytes per instance if the order of
/// the sums is fixed.
class CudaScores {
  public:
    /// Starts with scores of zero.
    CudaScores(std::int64_t n, cudaStream_t stream);

    /// Adds a view that was blended into `image`. Uses float atomics, whose order varies from run to run. With `slots`,
    /// which belong to `num_instances` instances, the order is fixed.
    void add(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, const SlotMap* slots,
             std::int64_t num_instances);

    /// Waits for the stream and returns the scores (n).
    std::vector<float> download() const;

  private:
    std::int64_t n_;
    cudaStream_t stream_;
    DeviceBuffer<float> scores_;
    DeviceBuffer<float> partial_;  ///< (slots, sub-tiles)
};

/// The residual sums of the Gaussians of a model that have a residual.
class CudaResidualScores {
  public:
    /// Returns the bytes that an object takes while it lives.
    static std::int64_t bytes(std::int64_t num_residuals) {
        return num_residuals * std::int64_t(sizeof(Vec3<float>) + sizeof(ResidualSums));
    }
    CudaResidualScores(std::int64_t num_residuals, cudaStream_t stream);

    /// Keeps the gradients by the colours, from the backward pass of a view's error. `counts` is 0 for a
    /// Gaussian that is not in view.
    void keep_gradients(const std::uint32_t* counts, const PackedSums* sums);
    /// Adds the view, with the sums of the backward pass of its weights.
    void add(const ParameterView<float>& params, const std::uint32_t* counts, const PackedSplat* splats,
             const PackedSums* sums);
    /// Waits for the stream and returns the sums.
    std::vector<ResidualSums> download() const;

  private:
    std::int64_t num_residuals_;
    cudaStream_t stream_;
    DeviceBuffer<Vec3<float>> gradients_;
    DeviceBuffer<ResidualSums> sums_;
};

}  // namespace gs
