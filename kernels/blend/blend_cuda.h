// SPDX-License-Identifier: Apache-2.0
// Blending on the device: forward per pixel (docs/math/rasterizer.md#blending), backward per chunk of a tile's list
// (docs/math/rasterizer.md#blend-gradient).
//
// A warp owns 8x4 pixels of a tile, the sub-tile, or in tiles with long lists a quarter of one. The forward pass tests
// each splat against all sub-tiles of a tile, and notes which splats changed a pixel of which; the backward pass visits
// only those. The backward pass cuts a long list into chunks. Each starts from the state that the forward pass saved
// there.
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

/// The number of instances of a tile between two saved states. It is small enough that the backward pass of the longest
/// list spreads over the device, and large enough that states (16 bytes a pixel) take little memory.
inline constexpr int kChunk = 192;
inline constexpr int kSubX = 8, kSubY = 4, kSubTiles = kCudaTilePixels / 32;

/// The sums of one Gaussian over all pixels, in three 16-byte groups so that the device adds them with three atomics.
struct alignas(16) PackedSums {
    float4 a;  ///< h, hx, hy, hxx
    float4 b;  ///< hxy, hyy, r, g
    float4 c;  ///< b, unused

    __device__ SplatSums<float> sums() const { return {a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x}; }
};

/// A part of a tile's list. A warp walks it for two of the tile's sub-tiles, one after the other.
struct alignas(16) BlendChunk {
    std::uint32_t tile, tile_begin;  ///< the tile, and the first instance of its list
    std::uint32_t first;             ///< instances first .. first+kChunk of the tile
    std::uint32_t corner;            ///< the tile's first pixel: x | y << 16
};

/// What the forward pass keeps for the backward pass.
struct BlendTrail {
    float4* checkpoints = nullptr;  ///< (chunks but the first of each tile, 192): colour so far and transmittance
    BlendChunk* chunks = nullptr;
    std::uint32_t* hits = nullptr;       ///< by 32 instances and sub-tile: which of them changed a pixel of it
    std::uint32_t* processed = nullptr;  ///< by tile and sub-tile: instances until all its pixels were finished
    unsigned* next_item = nullptr;       ///< the next chunk and two sub-tiles for a warp of the backward pass
    float4* zeros = nullptr;             ///< what the forward pass sets to 0 beside its work
    std::size_t num_zeros = 0;
};

/// Gradients that go into and come out of the backward pass.
struct BlendGradients {
    const float* dL_dimage;  ///< (3,H,W)
    PackedSums* sums;        ///< (n)
    std::int64_t n;
    const SlotMap* slots;  ///< null: float atomics add to the sums, which are 0 before
};

/// What a view is blended into.
struct BlendImage {
    int width, height;
    Vec3<float> background;
    float *rgb, *transmittance;  ///< (3,H,W), (H,W)
    Cutoffs<float> cutoffs;
};

class CudaBlend {
  public:
    /// Takes the buffers that live from the forward to the backward pass. A forward pass for a backward pass sets the
    /// first `num_sums` of `sums`, which stay where they are until then, to 0.
    void take(Carver& c, std::int64_t capacity, int num_tiles, PackedSums* sums, std::int64_t num_sums);
    /// Takes the buffer that only the backward pass with a fixed order of sums uses.
    void take_partial_sums(Carver& c, std::int64_t capacity);

    /// Returns what must be 0 before a forward pass for a backward pass: the blocks that share a tile add to it.
    std::span<uint4> marks() const { return marks_; }
    /// Blends a view into `image`. With `for_backward` it keeps the lists and states for backward().
    void forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control,
                 bool for_backward, cudaStream_t stream);
    /// Adds to the sums. The order of float atomics varies from run to run. With slots, sums are written instead, each
    /// added up in the order of its instances; those of invisible Gaussians are left alone.
    void backward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image,
                  const BlendGradients& gradients, const StepControl* control, cudaStream_t stream);
    /// Makes ready for another backward pass of the same forward pass: sums and work done are 0 again.
    void begin_again(cudaStream_t stream);

  private:
    std::int64_t capacity_ = 0;
    std::span<uint4> marks_;  ///< hits and counts of processed instances, which lie behind each other
    BlendTrail trail_;
    PackedSums* partial_ = nullptr;  ///< (slots, sub-tiles)
};

// The medians of a view's pixels on the device (docs/math/rasterizer.md#median).

/// Replaces the colours of a view that was blended into `image` by those of the pixels' medians; 0 if transmittance
/// stays above 1/2.
void write_medians(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, cudaStream_t stream);

// The scores of all Gaussians on the device, gathered view by view (docs/math/densification.md#pruning-by-score).

/// The scores of n Gaussians. It holds 4 bytes a Gaussian while it lives, and 24 bytes an instance more with a fixed
/// order of sums.
class CudaScores {
  public:
    /// Starts with scores of zero.
    CudaScores(std::int64_t n, cudaStream_t stream);

    /// Adds a view that was blended into `image`. It uses float atomics, whose order varies from run to run. With
    /// `slots`, which belong to `num_instances`, the order is fixed.
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

/// The sums of the Gaussians of a model that have a residual.
class CudaResidualScores {
  public:
    /// Returns what an object takes while it lives.
    static std::int64_t bytes(std::int64_t num_residuals) {
        return num_residuals * std::int64_t(sizeof(Vec3<float>) + sizeof(ResidualSums));
    }
    CudaResidualScores(std::int64_t num_residuals, cudaStream_t stream);

    /// Keeps the gradients by the colours, from the backward pass of a view's error. `counts` of 0: out of view.
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
