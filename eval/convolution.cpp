// SPDX-License-Identifier: Apache-2.0
// Convolution as matrix products over blocks of output pixels, and pooling.
#include "eval/convolution.h"

#include <spdlog/fmt/fmt.h>

// GCC 12 takes the deliberately undefined operands in its AVX-512 header for mistakes (GCC bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <Eigen/Core>
#pragma GCC diagnostic pop
#include <algorithm>
#include <cmath>
#include <memory>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"

namespace gs {
namespace {

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

int output_side(int n, int kernel, int stride, int padding) {
    return n + 2 * padding < kernel ? 0 : (n + 2 * padding - kernel) / stride + 1;
}

/// A map of the size that a window leaves of `in`.
FeatureMap output_of(const FeatureMap& in, int channels, int kernel, int stride, int padding) {
    const int height = output_side(in.height, kernel, stride, padding), width = output_side(in.width, kernel, stride, padding);
    if (height == 0 || width == 0)
        throw UsageError(fmt::format("{}x{} values are too few for a window of {}", in.width, in.height, kernel));
    return {channels, height, width};
}

/// Values of one input row under output pixels [begin, end) for one horizontal offset of the window; zeros outside.
void gather_row(const float* row, int width, int stride, int first, int begin, int end, float* out) {
    if (stride != 1) {
        for (int x = begin; x < end; ++x) {
            const int source = x * stride + first;
            *out++ = source >= 0 && source < width ? row[source] : 0.0f;
        }
        return;
    }
    const int inside_begin = std::clamp(-first, begin, end), inside_end = std::clamp(width - first, inside_begin, end);
    out = std::fill_n(out, inside_begin - begin, 0.0f);
    out = std::copy(row + inside_begin + first, row + inside_end + first, out);
    std::fill_n(out, end - inside_end, 0.0f);
}

/// Columns of inputs for output pixels [begin, begin + count): (in * kernel * kernel, count).
void gather(const FeatureMap& in, const ConvLayer& layer, int out_width, std::int64_t begin, std::int64_t count, float* columns) {
    for (int c = 0; c < layer.in; ++c) {
        for (int ky = 0; ky < layer.kernel; ++ky) {
            for (int kx = 0; kx < layer.kernel; ++kx) {
                for (std::int64_t i = 0; i < count;) {
                    const int y = int((begin + i) / out_width), x = int((begin + i) % out_width);
                    const int end = int(std::min<std::int64_t>(out_width, x + count - i));
                    const int source = y * layer.stride - layer.padding + ky;
                    if (source < 0 || source >= in.height)
                        std::fill_n(columns + i, end - x, 0.0f);
                    else
                        gather_row(in.plane(c) + std::size_t(source) * in.width, in.width, layer.stride, kx - layer.padding, x, end,
                                   columns + i);
                    i += end - x;
                }
                columns += count;
            }
        }
    }
}

}  // namespace

FeatureMap convolve(const FeatureMap& in, const ConvLayer& layer, bool relu) {
    if (in.channels != layer.in)
        throw UsageError(fmt::format("{} channels given to a convolution of {}", in.channels, layer.in));
    FeatureMap out = output_of(in, layer.out, layer.kernel, layer.stride, layer.padding);
    const auto pixels = std::int64_t(out.pixels());
    const std::int64_t depth = std::int64_t(layer.in) * layer.kernel * layer.kernel;
    // Columns stay near the cache, but there are enough of them that repacking the weights for each block costs little.
    const std::int64_t block = std::clamp<std::int64_t>((std::int64_t(1) << 19) / depth, 256, 4096);
    const Eigen::Map<const Matrix> weights(layer.weights.data(), layer.out, depth);
    const Eigen::Map<const Eigen::VectorXf> bias(layer.bias.data(), layer.out);
    parallel_for(num_parts(pixels, block), [&](std::int64_t part) {
        const std::int64_t begin = part * block, count = std::min(block, pixels - begin);
        const auto columns = std::make_unique_for_overwrite<float[]>(std::size_t(depth * count));
        gather(in, layer, out.width, begin, count, columns.get());
        Eigen::Map<Matrix, 0, Eigen::OuterStride<>> result(out.values.data() + begin, layer.out, count, Eigen::OuterStride<>(pixels));
        result.noalias() = weights * Eigen::Map<const Matrix>(columns.get(), depth, count);
        result.colwise() += bias;
        if (relu) result = result.cwiseMax(0.0f);
    });
    return out;
}

FeatureMap max_pool(const FeatureMap& in, int size, int stride) {
    FeatureMap out = output_of(in, in.channels, size, stride, 0);
    parallel_for(in.channels, [&](std::int64_t c) {
        const float* from = in.plane(int(c));
        float* to = out.plane(int(c));
        for (int y = 0; y < out.height; ++y) {
            for (int x = 0; x < out.width; ++x) {
                const float* window = from + std::size_t(y) * stride * in.width + std::size_t(x) * stride;
                float largest = *window;
                for (int ky = 0; ky < size; ++ky) {
                    for (int kx = 0; kx < size; ++kx) largest = std::max(largest, window[std::size_t(ky) * in.width + kx]);
                }
                *to++ = largest;
            }
        }
    });
    return out;
}

FeatureMap average_pool(const FeatureMap& in) {
    FeatureMap out = output_of(in, in.channels, 2, 2, 0);
    parallel_for(in.channels, [&](std::int64_t c) {
        float* to = out.plane(int(c));
        for (int y = 0; y < out.height; ++y) {
            const float* above = in.plane(int(c)) + std::size_t(2 * y) * in.width;
            const float* below = above + in.width;
            for (int x = 0; x < out.width; ++x) *to++ = (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]) * 0.25f;
        }
    });
    return out;
}

FeatureMap l2_pool(const FeatureMap& in) {
    FeatureMap out = output_of(in, in.channels, 3, 2, 1);
    parallel_for(in.channels, [&](std::int64_t c) {
        const float* from = in.plane(int(c));
        float* to = out.plane(int(c));
        for (int y = 0; y < out.height; ++y) {
            for (int x = 0; x < out.width; ++x) {
                float sum = 0;
                for (int ky = std::max(2 * y - 1, 0); ky <= std::min(2 * y + 1, in.height - 1); ++ky) {
                    for (int kx = std::max(2 * x - 1, 0); kx <= std::min(2 * x + 1, in.width - 1); ++kx) {
                        const float value = from[std::size_t(ky) * in.width + kx];
                        sum += float((ky == 2 * y ? 2 : 1) * (kx == 2 * x ? 2 : 1)) * value * value;
                    }
                }
                *to++ = std::sqrt(sum / 16 + 1e-12f);
            }
        }
    });
    return out;
}

FeatureMap upsample_aligned(const FeatureMap& in, int height, int width) {
    FeatureMap out(in.channels, height, width);
    const auto position = [](int i, int n) { return n < 2 ? 0.0f : float(std::min(i, 2 * n - 1)) * float(n - 1) / float(2 * n - 1); };
    parallel_for(height, [&](std::int64_t y) {
        const float fy = position(int(y), in.height);
        const int y0 = int(fy), y1 = std::min(y0 + 1, in.height - 1);
        for (int c = 0; c < in.channels; ++c) {
            const float *above = in.plane(c) + std::size_t(y0) * in.width, *below = in.plane(c) + std::size_t(y1) * in.width;
            float* to = out.plane(c) + std::size_t(y) * width;
            for (int x = 0; x < width; ++x) {
                const float fx = position(x, in.width), tx = fx - float(int(fx)), ty = fy - float(y0);
                const int x0 = int(fx), x1 = std::min(x0 + 1, in.width - 1);
                to[x] = (1 - ty) * ((1 - tx) * above[x0] + tx * above[x1]) + ty * ((1 - tx) * below[x0] + tx * below[x1]);
            }
        }
    });
    return out;
}

}  // namespace gs
