// SPDX-License-Identifier: Apache-2.0
// Convolution as a matrix product: weights (out, depth) times columns (depth, pixels), depth = in * kernel * kernel.
// The columns hold the input under the window and are only ever written to shared memory.
//
// A block computes 64 channels of 128 pixels. Its 128 threads each keep 8x8 sums in registers, so that 16 values read
// from shared memory serve 64 FMAs. While one slice of the depth is multiplied, the next is loaded from memory to
// registers. All arithmetic is single precision, so the FMA rate determines the minimum time. VGG16 up to relu5_3 takes
// 130 G FMAs for 800x532 pixels, 4 ms at 32 T FMA/s. The last layers of small images have fewer blocks than a large GPU
// has multiprocessors, and take longer.
#include "kernels/base/portable.h"
#include "kernels/cuda/cuda.h"
#include "kernels/tensors/convolution_cuda.h"

namespace gs {
namespace {

constexpr int kOutTile = 64, kPixelTile = 128, kSlice = 8, kThreads = 128;
/// Thread layout on the tile: 8 x 16. Each thread has two runs of four channels and two runs of four pixels, half a
/// tile apart, so that float4 reads have no bank conflicts.
constexpr int kRun = 4, kSums = 2 * kRun, kThreadColumns = kPixelTile / kSums;
constexpr int kWeightsPerThread = kOutTile * kSlice / kThreads;
/// Padding that puts stores of the transposed weights into different banks, and keeps rows aligned to 16 bytes.
constexpr int kPadding = 4;

struct ConvolutionArgs {
    const float *in, *weights, *bias;
    float* out;
    int in_height, in_width;
    int out_channels, out_width, out_pixels;
    int kernel, stride, padding, depth;
    bool relu;
};

struct Slice {
    float weights[kSlice][kOutTile + kPadding];
    float columns[kSlice][kPixelTile];
};

/// Fetches one thread's part of a slice: the inputs under its pixel, and a piece of one channel's weights.
class Fetch {
  public:
    __device__ Fetch(const ConvolutionArgs& a, int first_channel, int first_pixel)
        : pixel_(first_pixel + int(threadIdx.x)),
          y_(pixel_ / a.out_width * a.stride - a.padding),
          x_(pixel_ % a.out_width * a.stride - a.padding),
          channel_(first_channel + int(threadIdx.x) * kWeightsPerThread / kSlice),
          plane_(a.in) {}

    /// Reads the next slice, which begins at `depth`, with zeros outside the image, the layer and the tile.
    __device__ void read(const ConvolutionArgs& a, int depth) {
#pragma unroll
        for (int k = 0; k < kSlice; ++k) {
            const int y = y_ + ky_, x = x_ + kx_;
            const bool inside = pixel_ < a.out_pixels && depth + k < a.depth && unsigned(y) < unsigned(a.in_height) &&
                                unsigned(x) < unsigned(a.in_width);
            columns_[k] = inside ? plane_[std::size_t(y) * a.in_width + x] : 0.0f;
            if (++kx_ < a.kernel) continue;
            kx_ = 0;
            if (++ky_ < a.kernel) continue;
            ky_ = 0;
            plane_ += std::size_t(a.in_height) * a.in_width;
        }
        const int first = depth + first_weight();
#pragma unroll
        for (int k = 0; k < kWeightsPerThread; ++k)
            weights_[k] = channel_ < a.out_channels && first + k < a.depth
                              ? a.weights[std::size_t(channel_) * a.depth + first + k]
                              : 0.0f;
    }
    __device__ void store(Slice& slice) const {
#pragma unroll
        for (int k = 0; k < kSlice; ++k) slice.columns[k][threadIdx.x] = columns_[k];
#pragma unroll
        for (int k = 0; k < kWeightsPerThread; ++k)
            slice.weights[first_weight() + k][threadIdx.x * kWeightsPerThread / kSlice] = weights_[k];
    }

  private:
    static __device__ int first_weight() { return int(threadIdx.x) * kWeightsPerThread % kSlice; }

    int pixel_, y_, x_;  ///< y_, x_: position of the window's corner in the input
    int channel_;
    const float* plane_;
    int ky_ = 0, kx_ = 0;
    float columns_[kSlice], weights_[kWeightsPerThread];
};
static_assert(kPixelTile == kThreads && kSlice % kWeightsPerThread == 0);

/// Returns the channel or pixel, within the tile, of a thread's k-th sum.
__device__ int place(int thread, int k, int tile) { return k / kRun * (tile / 2) + thread * kRun + k % kRun; }

__device__ void read_runs(const float* row, int thread, int tile, float* out) {
#pragma unroll
    for (int half = 0; half < 2; ++half) {
        const float4 v = *reinterpret_cast<const float4*>(row + place(thread, half * kRun, tile));
        out[half * kRun] = v.x, out[half * kRun + 1] = v.y, out[half * kRun + 2] = v.z, out[half * kRun + 3] = v.w;
    }
}

__global__ void __launch_bounds__(kThreads) convolution(ConvolutionArgs a) {
    __shared__ __align__(16) Slice slices[2];
    const int first_channel = int(blockIdx.y) * kOutTile, first_pixel = int(blockIdx.x) * kPixelTile;
    const int row = int(threadIdx.x) / kThreadColumns, column = int(threadIdx.x) % kThreadColumns;
    float sums[kSums][kSums] = {};
    Fetch fetch(a, first_channel, first_pixel);
    fetch.read(a, 0);
    fetch.store(slices[0]);
    __syncthreads();
    int current = 0;
    for (int depth = 0; depth < a.depth; depth += kSlice) {
        const bool more = depth + kSlice < a.depth;
        if (more) fetch.read(a, depth + kSlice);
#pragma unroll
        for (int k = 0; k < kSlice; ++k) {
            float weights[kSums], columns[kSums];
            read_runs(slices[current].weights[k], row, kOutTile, weights);
            read_runs(slices[current].columns[k], column, kPixelTile, columns);
#pragma unroll
            for (int i = 0; i < kSums; ++i)
#pragma unroll
                for (int j = 0; j < kSums; ++j) sums[i][j] = fmaf(weights[i], columns[j], sums[i][j]);
        }
        if (!more) break;
        current ^= 1;
        fetch.store(slices[current]);  // its readers are done: they passed the barrier of the previous slice
        __syncthreads();
    }
#pragma unroll
    for (int i = 0; i < kSums; ++i) {
        const int channel = first_channel + place(row, i, kOutTile);
        if (channel >= a.out_channels) continue;
        const float bias = a.bias[channel];
        float* out = a.out + std::size_t(channel) * a.out_pixels;
#pragma unroll
        for (int j = 0; j < kSums; ++j) {
            const int pixel = first_pixel + place(column, j, kPixelTile);
            const float value = sums[i][j] + bias;
            if (pixel < a.out_pixels) out[pixel] = a.relu ? gs_max(value, 0.0f) : value;
        }
    }
}

}  // namespace

void launch_convolution(const Tensor& in, const ConvLayer& layer, bool relu, const Tensor& out) {
    const ConvolutionArgs args{.in = in.values.get(),
                               .weights = layer.weights.values.get(),
                               .bias = layer.bias.values.get(),
                               .out = out.values.get(),
                               .in_height = in.height,
                               .in_width = in.width,
                               .out_channels = out.channels,
                               .out_width = out.width,
                               .out_pixels = int(out.pixels()),
                               .kernel = layer.kernel,
                               .stride = layer.stride,
                               .padding = layer.padding,
                               .depth = layer.in * layer.kernel * layer.kernel,
                               .relu = relu};
    const dim3 blocks(num_blocks(std::int64_t(out.pixels()), kPixelTile), num_blocks(out.channels, kOutTile));
    convolution<<<blocks, kThreads>>>(args);
    GS_CUDA_LAUNCHED("convolution");
}

}  // namespace gs
