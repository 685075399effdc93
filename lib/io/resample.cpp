// SPDX-License-Identifier: Apache-2.0
// Resizes images: area-exact box filter when shrinking, bilinear when enlarging, one axis at a time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/io/image.h"

namespace gs {
namespace {

/// The filter of one axis: for every output index, the first input index and the weights (sum 1) of the inputs from
/// there on.
struct AxisFilter {
    std::vector<int> first;
    std::vector<std::size_t> offset;  ///< index into `weights`; one more entry than outputs
    std::vector<float> weights;
};

AxisFilter make_axis_filter(int in, int out) {
    AxisFilter filter;
    filter.offset.push_back(0);
    const double scale = double(in) / out;
    for (int o = 0; o < out; ++o) {
        if (in >= out) {
            const double low = o * scale, high = (o + 1) * scale;
            const int first = std::min(int(low), in - 1);
            filter.first.push_back(first);
            double sum = 0;
            const std::size_t begin = filter.weights.size();
            for (int i = first; i < in && i < high; ++i) {
                const double overlap = std::min(high, i + 1.0) - std::max(low, double(i));
                if (overlap < 1e-9 && i > first) break;  // `high` was rounded past a pixel edge
                filter.weights.push_back(float(overlap));
                sum += overlap;
            }
            for (std::size_t k = begin; k < filter.weights.size(); ++k) filter.weights[k] /= float(sum);
        } else {
            const double center = std::clamp((o + 0.5) * scale - 0.5, 0.0, in - 1.0);
            const int first = std::min(int(center), std::max(0, in - 2));
            filter.first.push_back(first);
            const float fraction = float(center - first);
            filter.weights.push_back(1 - fraction);
            if (in > 1) filter.weights.push_back(fraction);
        }
        filter.offset.push_back(filter.weights.size());
    }
    return filter;
}

/// Filters row y along x. Colour is premultiplied first, so that invisible colours do not bleed into visible ones.
void filter_row(const Image& in, int y, const AxisFilter& axis, std::vector<float>& scratch, std::vector<float>& out) {
    const int channels = in.channels;
    const std::size_t row = std::size_t(y) * in.width * channels;
    if (in.is_float())
        std::copy_n(in.f32.begin() + row, scratch.size(), scratch.begin());
    else
        std::transform(in.u8.begin() + row, in.u8.begin() + row + scratch.size(), scratch.begin(),
                       [](std::uint8_t v) { return v / 255.0f; });
    if (channels == 4)
        for (std::size_t i = 0; i < scratch.size(); i += 4)
            for (int c = 0; c < 3; ++c) scratch[i + c] *= scratch[i + 3];
    std::fill(out.begin(), out.end(), 0.0f);
    for (std::size_t o = 0; o < axis.first.size(); ++o)
        for (std::size_t k = axis.offset[o]; k < axis.offset[o + 1]; ++k) {
            const float* source = &scratch[(axis.first[o] + (k - axis.offset[o])) * channels];
            for (int c = 0; c < channels; ++c) out[o * channels + c] += axis.weights[k] * source[c];
        }
}

void store_row(const std::vector<float>& sums, int y, Image& out) {
    const std::size_t row = std::size_t(y) * sums.size();
    for (std::size_t i = 0; i < sums.size(); ++i) {
        float v = sums[i];
        if (out.channels == 4 && i % 4 != 3) {
            const float alpha = sums[i - i % 4 + 3];
            v = alpha > 0 ? v / alpha : 0;
        }
        if (out.is_float())
            out.f32[row + i] = v;
        else
            out.u8[row + i] = to_8_bits(v);
    }
}

}  // namespace

Image resize_image(const Image& in, int width, int height) {
    if (width <= 0 || height <= 0)
        throw UsageError(fmt::format("resize_image: target size {}x{} must be positive", width, height));
    if (width == in.width && height == in.height) return in;
    Image out;
    out.width = width;
    out.height = height;
    out.channels = in.channels;
    const std::size_t samples = std::size_t(width) * height * in.channels;
    if (in.is_float())
        out.f32.resize(samples);
    else
        out.u8.resize(samples);

    const AxisFilter across = make_axis_filter(in.width, width), down = make_axis_filter(in.height, height);
    std::vector<float> scratch(std::size_t(in.width) * in.channels), sums(std::size_t(width) * in.channels);
    // Input rows are needed in order, and at most the last two are needed twice. So two filtered rows suffice instead
    // of a whole float image.
    std::array<std::vector<float>, 2> rows{std::vector<float>(sums.size()), std::vector<float>(sums.size())};
    std::array<int, 2> row_index{-1, -1};
    for (int y = 0; y < height; ++y) {
        std::fill(sums.begin(), sums.end(), 0.0f);
        for (std::size_t k = down.offset[y]; k < down.offset[y + 1]; ++k) {
            const int source = down.first[y] + int(k - down.offset[y]);
            std::vector<float>& row = rows[source % 2];
            if (row_index[source % 2] != source) {
                filter_row(in, source, across, scratch, row);
                row_index[source % 2] = source;
            }
            for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += down.weights[k] * row[i];
        }
        store_row(sums, y, out);
    }
    return out;
}

}  // namespace gs
