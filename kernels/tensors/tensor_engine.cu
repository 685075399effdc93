// SPDX-License-Identifier: Apache-2.0
// The engine on the device. Each value is computed by one thread; sums are in double, and the host adds up their parts
// in order. The default stream orders all work. Memory comes from the driver's pool, so that layers need not wait for
// each other's buffers.
#include <algorithm>

#include "kernels/cuda/cuda.h"
#include "kernels/cuda/cuda_device.h"
#include "kernels/tensors/convolution_cuda.h"
#include "kernels/tensors/layers_device.h"
#include "kernels/tensors/tensor_checks.h"

namespace gs {
namespace {

constexpr int kBlock = 256;

template <class T> std::shared_ptr<T[]> allocate(std::size_t n) {
    void* data = nullptr;
    const cudaError_t error = cudaMallocAsync(&data, std::max<std::size_t>(n, 1) * sizeof(T), nullptr);
    if (error == cudaErrorMemoryAllocation) {
        cudaGetLastError();
        throw DeviceError("out of device memory: asked for " + std::to_string(n * sizeof(T) >> 20) +
                          " MiB for a layer of a metric; use --device cpu");
    }
    cuda_check(error, "cudaMallocAsync");
    return {static_cast<T*>(data), [](T* p) { cudaFreeAsync(p, nullptr); }};
}

Tensor allocated(Tensor shape) {
    shape.values = allocate<float>(shape.size());
    return shape;
}

/// The position of value i of a tensor.
struct Place {
    std::size_t plane;
    int y, x;
};
__device__ Place place_of(std::size_t i, int height, int width) {
    const std::size_t pixels = std::size_t(height) * width, pixel = i % pixels;
    return {i / pixels, int(pixel / width), int(pixel % width)};
}

/// Sets out[i] = value(plane of `in`, y, x).
template <class Value>
__global__ void __launch_bounds__(kBlock)
    each_value(const float* in, std::size_t in_pixels, float* out, std::size_t n, int height, int width, Value value) {
    const std::size_t i = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i >= n) return;
    const Place p = place_of(i, height, width);
    out[i] = value(in + p.plane * in_pixels, p.y, p.x);
}

template <class Value> Tensor make_each(const char* name, const Tensor& in, const Tensor& shape, Value value) {
    const Tensor out = allocated(shape);
    each_value<<<num_blocks(std::int64_t(out.size()), kBlock), kBlock>>>(in.values.get(), in.pixels(), out.values.get(),
                                                                         out.size(), out.height, out.width, value);
    GS_CUDA_LAUNCHED(name);
    return out;
}

__global__ void __launch_bounds__(kBlock)
    add_logistic_values(const float* x, const float* y, float* out, std::size_t n) {
    const std::size_t i = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i < n) out[i] = sigmoid(x[i]) + y[i];
}

/// Returns the sum over the block in every thread. All threads must call it.
__device__ double block_sum(double x) {
    __shared__ double warps[kBlock / 32];
    x = warp_sum(x);
    __syncthreads();  // the sums of the last call have then been read
    if (threadIdx.x % 32 == 0) warps[threadIdx.x / 32] = x;
    __syncthreads();
    double sum = 0;
    for (int w = 0; w < kBlock / 32; ++w) sum += warps[w];
    return sum;
}

/// Sums the distances of the pixels, with one thread per pixel. Writes the blocks' sums to `parts`.
__global__ void __launch_bounds__(kBlock) direction_distances(const float* a, const float* b, const float* weights,
                                                              int channels, std::size_t pixels, double* parts) {
    const std::size_t p = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    double sum = 0;
    if (p < pixels) {
        double norm_a = 0, norm_b = 0;
        for (int c = 0; c < channels; ++c) {
            const double va = a[c * pixels + p], vb = b[c * pixels + p];
            norm_a += va * va, norm_b += vb * vb;
        }
        norm_a = 1 / (sqrt(norm_a) + kDirectionEpsilon), norm_b = 1 / (sqrt(norm_b) + kDirectionEpsilon);
        for (int c = 0; c < channels; ++c) {
            // Both products are rounded. If they were fused into the subtraction, only one would be, and identical
            // images would differ.
            const double difference = __dmul_rn(a[c * pixels + p], norm_a) - __dmul_rn(b[c * pixels + p], norm_b);
            sum += double(weights[c]) * difference * difference;
        }
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) parts[blockIdx.x] = sum;
}

/// Compares the channels, with one block per channel.
__global__ void __launch_bounds__(kBlock)
    compare_planes(const float* a, const float* b, std::size_t pixels, ChannelComparison* out) {
    a += blockIdx.x * pixels, b += blockIdx.x * pixels;
    double mean_a = 0, mean_b = 0;
    for (std::size_t p = threadIdx.x; p < pixels; p += kBlock) mean_a += a[p], mean_b += b[p];
    mean_a = block_sum(mean_a) / double(pixels), mean_b = block_sum(mean_b) / double(pixels);
    double variance_a = 0, variance_b = 0, difference = 0;
    for (std::size_t p = threadIdx.x; p < pixels; p += kBlock) {
        const double da = a[p] - mean_a, db = b[p] - mean_b;
        variance_a += da * da, variance_b += db * db, difference += (da - db) * (da - db);
    }
    variance_a = block_sum(variance_a) / double(pixels), variance_b = block_sum(variance_b) / double(pixels),
    difference = block_sum(difference) / double(pixels);
    if (threadIdx.x == 0) out[blockIdx.x] = {mean_a, mean_b, variance_a, variance_b, difference};
}

__global__ void __launch_bounds__(kBlock) masked_differences(const float* mask, const float* a, const float* b,
                                                             int channels, std::size_t pixels, double* parts) {
    const std::size_t p = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    double sum = 0;
    if (p < pixels)
        for (int c = 0; c < channels; ++c)
            sum += double(mask[p]) * gs_abs(double(a[c * pixels + p]) - double(b[c * pixels + p]));
    sum = block_sum(sum);
    if (threadIdx.x == 0) parts[blockIdx.x] = sum;
}

template <class T> std::vector<T> downloaded(const std::shared_ptr<T[]>& values, std::size_t n) {
    std::vector<T> host(n);
    GS_CUDA(cudaMemcpy(host.data(), values.get(), n * sizeof(T), cudaMemcpyDeviceToHost));
    return host;
}

/// Returns the sum of the `parts` that launch(blocks, parts) writes; there is one block for each kBlock of n.
template <class Launch> double sum_of_parts(std::size_t n, Launch launch) {
    const unsigned blocks = num_blocks(std::int64_t(n), kBlock);
    const auto parts = allocate<double>(blocks);
    launch(blocks, parts.get());
    double sum = 0;
    for (const double part : downloaded(parts, blocks)) sum += part;
    return sum;
}

class CudaTensorEngine : public TensorEngine {
  public:
    CudaTensorEngine() {
        // Freed memory stays with the process, because the next image needs as much again.
        int device = 0;
        cudaMemPool_t pool;
        std::uint64_t keep = ~std::uint64_t(0);
        GS_CUDA(cudaGetDevice(&device));
        GS_CUDA(cudaDeviceGetDefaultMemPool(&pool, device));
        GS_CUDA(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep));
    }

    Tensor upload(int channels, int height, int width, const std::vector<float>& values) const override {
        const Tensor tensor = allocated({channels, height, width, nullptr});
        GS_CUDA(cudaMemcpy(tensor.values.get(), values.data(), tensor.size() * sizeof(float), cudaMemcpyHostToDevice));
        return tensor;
    }
    std::vector<float> download(const Tensor& tensor) const override {
        return downloaded(tensor.values, tensor.size());
    }

    Tensor convolve(const Tensor& in, const ConvLayer& layer, bool relu) const override {
        const Tensor out = allocated(shape_of_convolution(in, layer));
        launch_convolution(in, layer, relu, out);
        return out;
    }
    Tensor max_pool(const Tensor& in, int size, int stride) const override {
        return make_each("max_pool", in, shape_of_windows(in, in.channels, size, stride, 0),
                         [=, width = in.width] __device__(const float* from, int y, int x) {
                             return max_of_window(from + std::size_t(y) * stride * width + std::size_t(x) * stride,
                                                  width, size);
                         });
    }
    Tensor average_pool(const Tensor& in) const override {
        return make_each("average_pool", in, shape_of_windows(in, in.channels, 2, 2, 0),
                         [width = in.width] __device__(const float* from, int y, int x) {
                             return mean_of_window(from + std::size_t(2 * y) * width + 2 * x, width);
                         });
    }
    Tensor l2_pool(const Tensor& in) const override {
        return make_each("l2_pool", in, shape_of_windows(in, in.channels, 3, 2, 1),
                         [height = in.height, width = in.width] __device__(const float* from, int y, int x) {
                             return l2_of_window(from, height, width, y, x);
                         });
    }
    Tensor upsample_aligned(const Tensor& in, int height, int width) const override {
        return make_each("upsample_aligned", in, {in.channels, height, width, nullptr},
                         [h = in.height, w = in.width] __device__(const float* from, int y, int x) {
                             return aligned_sample(from, h, w, y, x);
                         });
    }
    Tensor stacked(std::initializer_list<Tensor> parts) const override {
        const Tensor all = allocated(shape_of_stack(parts));
        float* to = all.values.get();
        for (const Tensor& part : parts) {
            GS_CUDA(cudaMemcpyAsync(to, part.values.get(), part.size() * sizeof(float), cudaMemcpyDeviceToDevice));
            to += part.size();
        }
        return all;
    }
    Tensor add_logistic(const Tensor& x, const Tensor& y) const override {
        require_shape(y, x.channels, x.height, x.width);
        const Tensor out = allocated(x);
        add_logistic_values<<<num_blocks(std::int64_t(out.size()), kBlock), kBlock>>>(x.values.get(), y.values.get(),
                                                                                      out.values.get(), out.size());
        GS_CUDA_LAUNCHED("add_logistic");
        return out;
    }

    double direction_distance(const Tensor& a, const Tensor& b, const Tensor& weights) const override {
        require_shape(b, a.channels, a.height, a.width);
        require_shape(weights, a.channels, 1, 1);
        return sum_of_parts(a.pixels(),
                            [&](unsigned blocks, double* parts) {
                                direction_distances<<<blocks, kBlock>>>(a.values.get(), b.values.get(),
                                                                        weights.values.get(), a.channels, a.pixels(),
                                                                        parts);
                                GS_CUDA_LAUNCHED("direction_distances");
                            }) /
               double(a.pixels());
    }
    std::vector<ChannelComparison> compare_channels(const Tensor& a, const Tensor& b) const override {
        require_shape(b, a.channels, a.height, a.width);
        const auto out = allocate<ChannelComparison>(std::size_t(a.channels));
        compare_planes<<<unsigned(a.channels), kBlock>>>(a.values.get(), b.values.get(), a.pixels(), out.get());
        GS_CUDA_LAUNCHED("compare_planes");
        return downloaded(out, std::size_t(a.channels));
    }
    double masked_difference(const Tensor& mask, const Tensor& a, const Tensor& b) const override {
        require_shape(b, a.channels, a.height, a.width);
        require_shape(mask, 1, a.height, a.width);
        return sum_of_parts(a.pixels(),
                            [&](unsigned blocks, double* parts) {
                                masked_differences<<<blocks, kBlock>>>(mask.values.get(), a.values.get(),
                                                                       b.values.get(), a.channels, a.pixels(), parts);
                                GS_CUDA_LAUNCHED("masked_differences");
                            }) /
               double(a.size());
    }
};

}  // namespace

std::unique_ptr<TensorEngine> make_cuda_tensor_engine() {
    if (!cuda_available()) throw DeviceError("no CUDA device: " + cuda_unavailable_reason() + "; use --device cpu");
    return std::make_unique<CudaTensorEngine>();
}

}  // namespace gs
