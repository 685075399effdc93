// SPDX-License-Identifier: Apache-2.0
// A small convolution engine on the CPU, enough for the nets of learned metrics.
#pragma once

#include <cstddef>
#include <vector>

namespace gs {

/// Planar float array (channels, height, width).
struct FeatureMap {
    int channels = 0, height = 0, width = 0;
    std::vector<float> values;

    FeatureMap() = default;
    FeatureMap(int c, int h, int w) : channels(c), height(h), width(w), values(std::size_t(c) * h * w) {}
    std::size_t pixels() const { return std::size_t(height) * width; }
    float* plane(int c) { return values.data() + pixels() * std::size_t(c); }
    const float* plane(int c) const { return values.data() + pixels() * std::size_t(c); }
};

/// A square convolution (correlation, as nets mean it) with zero padding.
struct ConvLayer {
    int in = 0, out = 0, kernel = 0, stride = 1, padding = 0;
    std::vector<float> weights;  ///< (out, in, kernel, kernel)
    std::vector<float> bias;     ///< (out)
};

/// The layer, followed by max(0, .) where `relu`. Output sides are floor((n + 2 padding - kernel) / stride) + 1. Single
/// precision; the same for any number of threads. Holds input and output, and 2 MiB to 8 MiB for each thread. Throws
/// UsageError when the channels do not fit or the input is smaller than the kernel.
FeatureMap convolve(const FeatureMap& in, const ConvLayer& layer, bool relu);

/// Largest value of each size x size window, without padding; windows that leave the map are dropped. Throws UsageError when
/// none fits.
FeatureMap max_pool(const FeatureMap& in, int size, int stride);

/// Mean of each 2x2 window, stride 2; an odd last row or column is dropped. Throws UsageError when none fits.
FeatureMap average_pool(const FeatureMap& in);

/// sqrt(sum of g x^2 + 1e-12) with stride 2 and zeros outside, g = (1,2,1) x (1,2,1) / 16: the inner values of a Hanning window
/// of 5. Source: Ding et al. 2020, "Image Quality Assessment: Unifying Structure and Texture Similarity", section 3.1.
FeatureMap l2_pool(const FeatureMap& in);

/// Twice the size, bilinear between corner pixels that stay at the corners (align_corners), then the last row and column
/// repeated until (height, width) is reached.
FeatureMap upsample_aligned(const FeatureMap& in, int height, int width);

}  // namespace gs
