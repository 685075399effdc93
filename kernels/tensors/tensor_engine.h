// SPDX-License-Identifier: Apache-2.0
// The layers and sums that the nets of learned metrics are made of, on the CPU or on a GPU.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <vector>

namespace gs {

/// Planar floats (channels, height, width) in the memory of the engine that made them. Copies share them; the last one frees them.
struct Tensor {
    int channels = 0, height = 0, width = 0;
    std::shared_ptr<float[]> values;

    std::size_t pixels() const { return std::size_t(height) * std::size_t(width); }
    std::size_t size() const { return pixels() * std::size_t(channels); }
};

/// A square convolution (correlation, as nets mean it) with zero padding.
struct ConvLayer {
    int in = 0, out = 0, kernel = 0, stride = 1, padding = 0;
    Tensor weights = {};  ///< (out, in, kernel * kernel)
    Tensor bias = {};     ///< (out, 1, 1)
};

/// How the pixels of one channel of two maps compare; all in double.
struct ChannelComparison {
    double mean_a = 0, mean_b = 0;
    double variance_a = 0, variance_b = 0;  ///< of the population
    double difference = 0;                  ///< mean of ((a - mean_a) - (b - mean_b))^2
};

/// Single precision; equal inputs give equal bits, on the CPU for any number of threads. Tensors of one engine only. All calls throw UsageError
/// for tensors that do not fit, and on a GPU DeviceError, naming the bytes when its memory is full.
class TensorEngine {
  public:
    virtual ~TensorEngine() = default;

    /// `values` as the Tensor holds them, as many as its sizes say.
    virtual Tensor upload(int channels, int height, int width, const std::vector<float>& values) const = 0;
    virtual std::vector<float> download(const Tensor& tensor) const = 0;

    /// The layer, followed by max(0, .) where `relu`. Output sides are floor((n + 2 padding - kernel) / stride) + 1.
    virtual Tensor convolve(const Tensor& in, const ConvLayer& layer, bool relu) const = 0;
    /// Largest value of each size x size window, without padding; windows that leave the map are dropped.
    virtual Tensor max_pool(const Tensor& in, int size, int stride) const = 0;
    /// Mean of each 2x2 window, stride 2; an odd last row or column is dropped.
    virtual Tensor average_pool(const Tensor& in) const = 0;
    /// sqrt(sum of g x^2 + 1e-12) with stride 2 and zeros outside, g = (1,2,1) x (1,2,1) / 16: the inner values of a Hanning window
    /// of 5. Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and Texture Similarity", section 3.1.
    virtual Tensor l2_pool(const Tensor& in) const = 0;
    /// Twice the size, bilinear between corner pixels that stay at the corners (align_corners), then the last row and column
    /// repeated until (height, width) is reached.
    virtual Tensor upsample_aligned(const Tensor& in, int height, int width) const = 0;
    /// The channels of all below one another; all of one size.
    virtual Tensor stacked(std::initializer_list<Tensor> parts) const = 0;
    /// The logistic function of x, plus y, value by value.
    virtual Tensor add_logistic(const Tensor& x, const Tensor& y) const = 0;

    /// Mean over pixels of the sum over channels of weights (C,1,1) times the squared difference, after the channels of each pixel were
    /// scaled to unit length (by 1 / (length + 1e-10)). Exactly 0 for equal maps.
    virtual double direction_distance(const Tensor& a, const Tensor& b, const Tensor& weights) const = 0;
    virtual std::vector<ChannelComparison> compare_channels(const Tensor& a, const Tensor& b) const = 0;
    /// Mean over pixels and channels of mask (1,H,W) times |a - b|.
    virtual double masked_difference(const Tensor& mask, const Tensor& a, const Tensor& b) const = 0;
};

std::unique_ptr<TensorEngine> make_cpu_tensor_engine();

/// On the current CUDA device. Throws DeviceError without one (cuda_device.h).
std::unique_ptr<TensorEngine> make_cuda_tensor_engine();

}  // namespace gs
