// SPDX-License-Identifier: Apache-2.0
// The engine on the CPU. Convolutions gather columns of input for blocks of pixels and multiply them with Eigen. Sums
// have a fixed order.
//
// GCC 12 warns about the deliberately undefined operands in its AVX-512 header (GCC bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <Eigen/Core>
#pragma GCC diagnostic pop
#include <algorithm>
#include <cmath>

#include "kernels/base/parallel.h"
#include "kernels/tensors/layers_device.h"
#include "kernels/tensors/tensor_checks.h"

namespace gs {
namespace {

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Tensor allocated(Tensor shape) {
    shape.values = std::make_shared_for_overwrite<float[]>(shape.size());
    return shape;
}

float* plane(const Tensor& t, int c) { return t.values.get() + t.pixels() * std::size_t(c); }

/// Gathers the values of one input row under output pixels [begin, end), for one horizontal offset of the window, with
/// zeros outside.
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

/// Gathers the columns of inputs for output pixels [begin, begin + count): (in * kernel * kernel, count).
void gather(const Tensor& in, const ConvLayer& layer, int out_width, std::int64_t begin, std::int64_t count,
            float* columns) {
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
                        gather_row(plane(in, c) + std::size_t(source) * in.width, in.width, layer.stride,
                                   kx - layer.padding, x, end, columns + i);
                    i += end - x;
                }
                columns += count;
            }
        }
    }
}

/// Returns a tensor of the given shape with out(c, y, x) = value(plane c of `in`, y, x).
template <class Value> Tensor each_value(const Tensor& in, const Tensor& shape, Value value) {
    const Tensor out = allocated(shape);
    parallel_for(std::int64_t(out.channels) * out.height, [&](std::int64_t row) {
        const int c = int(row / out.height), y = int(row % out.height);
        float* to = plane(out, c) + std::size_t(y) * out.width;
        for (int x = 0; x < out.width; ++x) to[x] = value(plane(in, c), y, x);
    });
    return out;
}

ChannelComparison compare_planes(const float* a, const float* b, std::size_t n) {
    ChannelComparison r;
    for (std::size_t i = 0; i < n; ++i) r.mean_a += a[i], r.mean_b += b[i];
    r.mean_a /= double(n), r.mean_b /= double(n);
    for (std::size_t i = 0; i < n; ++i) {
        const double da = a[i] - r.mean_a, db = b[i] - r.mean_b;
        r.variance_a += da * da, r.variance_b += db * db, r.difference += (da - db) * (da - db);
    }
    for (double* sum : {&r.variance_a, &r.variance_b, &r.difference}) *sum /= double(n);
    return r;
}

class CpuTensorEngine : public TensorEngine {
  public:
    Tensor upload(int channels, int height, int width, const std::vector<float>& values) const override {
        const Tensor tensor = allocated({channels, height, width, nullptr});
        std::copy_n(values.begin(), tensor.size(), tensor.values.get());
        return tensor;
    }
    std::vector<float> download(const Tensor& tensor) const override {
        return {tensor.values.get(), tensor.values.get() + tensor.size()};
    }

    /// Takes 2 MiB to 8 MiB per thread in addition to input and output.
    Tensor convolve(const Tensor& in, const ConvLayer& layer, bool relu) const override {
        const Tensor out = allocated(shape_of_convolution(in, layer));
        const auto pixels = std::int64_t(out.pixels());
        const std::int64_t depth = std::int64_t(layer.in) * layer.kernel * layer.kernel;
        // The columns about fit into the cache. There are enough of them that repacking the weights for each block
        // costs little.
        const std::int64_t block = std::clamp<std::int64_t>((std::int64_t(1) << 19) / depth, 256, 4096);
        const Eigen::Map<const Matrix> weights(layer.weights.values.get(), layer.out, depth);
        const Eigen::Map<const Eigen::VectorXf> bias(layer.bias.values.get(), layer.out);
        parallel_for(num_parts(pixels, block), [&](std::int64_t part) {
            const std::int64_t begin = part * block, count = std::min(block, pixels - begin);
            const auto columns = std::make_unique_for_overwrite<float[]>(std::size_t(depth * count));
            gather(in, layer, out.width, begin, count, columns.get());
            Eigen::Map<Matrix, 0, Eigen::OuterStride<>> result(out.values.get() + begin, layer.out, count,
                                                               Eigen::OuterStride<>(pixels));
            result.noalias() = weights * Eigen::Map<const Matrix>(columns.get(), depth, count);
            result.colwise() += bias;
            if (relu) result = result.cwiseMax(0.0f);
        });
        return out;
    }

    Tensor max_pool(const Tensor& in, int size, int stride) const override {
        return each_value(in, shape_of_windows(in, in.channels, size, stride, 0), [&](const float* from, int y, int x) {
            return max_of_window(from + std::size_t(y) * stride * in.width + std::size_t(x) * stride, in.width, size);
        });
    }
    Tensor average_pool(const Tensor& in) const override {
        return each_value(in, shape_of_windows(in, in.channels, 2, 2, 0), [&](const float* from, int y, int x) {
            return mean_of_window(from + std::size_t(2 * y) * in.width + 2 * x, in.width);
        });
    }
    Tensor l2_pool(const Tensor& in) const override {
        return each_value(in, shape_of_windows(in, in.channels, 3, 2, 1), [&](const float* from, int y, int x) {
            return l2_of_window(from, in.height, in.width, y, x);
        });
    }
    Tensor upsample_aligned(const Tensor& in, int height, int width) const override {
        return each_value(in, {in.channels, height, width, nullptr}, [&](const float* from, int y, int x) {
            return aligned_sample(from, in.height, in.width, y, x);
        });
    }

    Tensor stacked(std::initializer_list<Tensor> parts) const override {
        const Tensor all = allocated(shape_of_stack(parts));
        float* to = all.values.get();
        for (const Tensor& part : parts) to = std::copy_n(part.values.get(), part.size(), to);
        return all;
    }

    Tensor add_logistic(const Tensor& x, const Tensor& y) const override {
        require_shape(y, x.channels, x.height, x.width);
        const Tensor out = allocated(x);
        for (std::size_t i = 0; i < out.size(); ++i) out.values[i] = sigmoid(x.values[i]) + y.values[i];
        return out;
    }

    double direction_distance(const Tensor& a, const Tensor& b, const Tensor& weights) const override {
        require_shape(b, a.channels, a.height, a.width);
        require_shape(weights, a.channels, 1, 1);
        const auto pixels = std::int64_t(a.pixels());
        std::vector<double> sums(std::size_t(num_parts(pixels)));  // added up in order afterwards
        parallel_for(num_parts(pixels), [&](std::int64_t part) {
            const std::int64_t begin = part * kPartSize, count = std::min(kPartSize, pixels - begin);
            std::vector<double> norm_a(std::size_t(count), 0.0), norm_b(std::size_t(count), 0.0);
            for (int c = 0; c < a.channels; ++c) {
                const float *va = plane(a, c) + begin, *vb = plane(b, c) + begin;
                for (std::int64_t i = 0; i < count; ++i)
                    norm_a[i] += double(va[i]) * va[i], norm_b[i] += double(vb[i]) * vb[i];
            }
            for (std::int64_t i = 0; i < count; ++i)
                norm_a[i] = 1 / (std::sqrt(norm_a[i]) + kDirectionEpsilon),
                norm_b[i] = 1 / (std::sqrt(norm_b[i]) + kDirectionEpsilon);
            // Scaling is a separate pass. If it were fused into the subtraction, one product would be rounded and the
            // other not, and identical images would differ.
            std::vector<double> unit_a(norm_a.size()), unit_b(norm_b.size());
            for (int c = 0; c < a.channels; ++c) {
                const float *va = plane(a, c) + begin, *vb = plane(b, c) + begin;
                for (std::int64_t i = 0; i < count; ++i) unit_a[i] = va[i] * norm_a[i], unit_b[i] = vb[i] * norm_b[i];
                double sum = 0;
                for (std::int64_t i = 0; i < count; ++i) sum += (unit_a[i] - unit_b[i]) * (unit_a[i] - unit_b[i]);
                sums[std::size_t(part)] += double(weights.values[c]) * sum;
            }
        });
        double sum = 0;
        for (const double s : sums) sum += s;
        return sum / double(pixels);
    }

    std::vector<ChannelComparison> compare_channels(const Tensor& a, const Tensor& b) const override {
        require_shape(b, a.channels, a.height, a.width);
        std::vector<ChannelComparison> all(std::size_t(a.channels));
        parallel_for(a.channels, [&](std::int64_t c) {
            all[std::size_t(c)] = compare_planes(plane(a, int(c)), plane(b, int(c)), a.pixels());
        });
        return all;
    }

    double masked_difference(const Tensor& mask, const Tensor& a, const Tensor& b) const override {
        require_shape(b, a.channels, a.height, a.width);
        require_shape(mask, 1, a.height, a.width);
        double sum = 0;
        for (int c = 0; c < a.channels; ++c) {
            const float *va = plane(a, c), *vb = plane(b, c);
            for (std::size_t p = 0; p < a.pixels(); ++p)
                sum += double(mask.values[p]) * std::abs(double(va[p]) - vb[p]);
        }
        return sum / double(a.size());
    }
};

}  // namespace

std::unique_ptr<TensorEngine> make_cpu_tensor_engine() { return std::make_unique<CpuTensorEngine>(); }

}  // namespace gs
