// SPDX-License-Identifier: Apache-2.0
// The layers and sums of the networks in learned metrics, on the CPU or on a GPU.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <vector>

namespace gs {

/// Planar floats (channels, height, width) in the memory of the engine that made them. Copies share the values; the
/// last copy frees them.
struct Tensor {
    int channels = 0, height = 0, width = 0;
    std::shared_ptr<float[]> values;

    std::size_t pixels() const { return std::size_t(height) * std::size_t(width); }
    std::size_t size() const { return pixels() * std::size_t(channels); }
};

/// A square convolution (a correlation, as in all neural networks) with zero padding.
struct ConvLayer {
    int in = 0, out = 0, kernel = 0, stride = 1, padding = 0;
    Tensor weights = {};  ///< (out, in, kernel * kernel)
    Tensor bias = {};     ///< (out, 1, 1)
};

/// The statistics of one channel of two maps over its pixels, computed in double.
struct ChannelComparison {
    double mean_a = 0, mean_b = 0;
    double variance_a = 0, variance_b = 0;  ///< population variances
    double difference = 0;                  ///< mean of ((a - mean_a) - (b - mean_b))^2
};

/// Computes layers and sums on one device, in single precision. Equal inputs give equal bits, on the CPU for any number
/// of threads. An engine accepts only its own tensors. All calls throw UsageError if the sizes of tensors do not match.
/// On a GPU they throw DeviceError with the number of bytes if its memory is full.
class TensorEngine {
  public:
    virtual ~TensorEngine() = default;

    /// Makes a tensor of `values`, which are planar; their number must match the sizes.
    virtual Tensor upload(int channels, int height, int width, const std::vector<float>& values) const = 0;
    virtual std::vector<float> download(const Tensor& tensor) const = 0;

    /// Applies the layer, followed by max(0, .) if `relu`. Output sides are floor((n + 2 padding - kernel) / stride) +
    /// 1.
    virtual Tensor convolve(const Tensor& in, const ConvLayer& layer, bool relu) const = 0;
    /// Returns the maximum of each size x size window, without padding. Windows that extend beyond the map are dropped.
    virtual Tensor max_pool(const Tensor& in, int size, int stride) const = 0;
    /// Returns the mean of each 2x2 window, with stride 2. An odd last row or column is dropped.
    virtual Tensor average_pool(const Tensor& in) const = 0;
    /// Returns sqrt(sum of g x^2 + 1e-12) with stride 2 and zeros outside. g = (1,2,1) x (1,2,1) / 16 are the inner
    /// values of a Hanning window of 5. Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and
    /// Texture Similarity", section 3.1.
    virtual Tensor l2_pool(const Tensor& in) const = 0;
    /// Doubles the size by bilinear interpolation that keeps corner pixels at the corners (align_corners), then repeats
    /// the last row and column up to (height, width).
    virtual Tensor upsample_aligned(const Tensor& in, int height, int width) const = 0;
    /// Stacks the channels of all parts, which must have the same size.
    virtual Tensor stacked(std::initializer_list<Tensor> parts) const = 0;
    /// Returns the logistic function of x, plus y, value by value.
    virtual Tensor add_logistic(const Tensor& x, const Tensor& y) const = 0;

    /// Scales the channels of each pixel to unit length (by 1 / (length + 1e-10)). Returns the mean over pixels of the
    /// sum over channels of weights (C,1,1) times the squared difference. It is exactly 0 for equal maps.
    virtual double direction_distance(const Tensor& a, const Tensor& b, const Tensor& weights) const = 0;
    virtual std::vector<ChannelComparison> compare_channels(const Tensor& a, const Tensor& b) const = 0;
    /// Returns the mean over pixels and channels of mask (1,H,W) times |a - b|.
    virtual double masked_difference(const Tensor& mask, const Tensor& a, const Tensor& b) const = 0;
};

std::unique_ptr<TensorEngine> make_cpu_tensor_engine();

/// Makes an engine on the current CUDA device. Throws DeviceError without one (cuda_device.h).
std::unique_ptr<TensorEngine> make_cuda_tensor_engine();

}  // namespace gs
