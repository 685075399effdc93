// SPDX-License-Identifier: Apache-2.0
// The controller on the CPU. Rows of blocks run in parallel, and their sums are added in order. The layers after the
// mean are small and run in one thread.
#include <algorithm>
#include <cmath>

#include "kernels/base/parallel.h"
#include "kernels/base/rng.h"
#include "kernels/ppisp/ppisp.h"

namespace gs {
namespace {

/// Computes out = W in + b.
template <class Real> void linear(const Real* weights, const ControllerLayer& layer, const Real* in, Real* out) {
    for (int o = 0; o < layer.outputs; ++o) {
        const Real* w = weights + layer.offset + std::ptrdiff_t(o) * layer.inputs;
        Real sum = weights[layer.bias() + o];
        for (int i = 0; i < layer.inputs; ++i) sum += w[i] * in[i];
        out[o] = sum;
    }
}

/// Adds to dL_din and to the layer's part of dL_dweights.
template <class Real>
void linear_backward(const Real* weights, const ControllerLayer& layer, const Real* in, const Real* dL_dout,
                     Real* dL_din, Real* dL_dweights) {
    for (int o = 0; o < layer.outputs; ++o) {
        const std::ptrdiff_t row = layer.offset + std::ptrdiff_t(o) * layer.inputs;
        const Real g = dL_dout[o];
        dL_dweights[layer.bias() + o] += g;
        for (int i = 0; i < layer.inputs; ++i) {
            dL_dweights[row + i] += g * in[i];
            dL_din[i] += g * weights[row + i];
        }
    }
}

constexpr int kEncoded = kControllerConv[3];  ///< number of channels of a bin

}  // namespace

template <class Real>
void Controller<Real>::forward(const Real* weights, const Real* image, int width, int height, Real prior_exposure,
                               Real* out) {
    width_ = width, height_ = height;
    std::fill(out, out + kIspFrameValues, Real(0));
    if (!controller_sees(width, height)) return;
    const int columns = controller_blocks(width), rows = controller_blocks(height);
    constexpr int kRowValues = kControllerBins * kControllerChannels;
    row_sums_.assign(std::size_t(rows) * kRowValues, Real(0));
    parallel_for(rows, [&](std::int64_t y) {
        Real* sums = row_sums_.data() + y * kRowValues;
        ControllerFeatures<Real> f;
        for (int x = 0; x < columns; ++x) {
            controller_features(weights, controller_block(image, width, height, x, int(y)), f);
            for (int bin = 0; bin < kControllerBins; ++bin) {
                if (!controller_bin_has(bin, columns, x)) continue;
                for (int c = 0; c < kControllerChannels; ++c) sums[bin * kControllerChannels + c] += f.out[c];
            }
        }
    });
    bins_.assign(kControllerGrid * kControllerChannels, Real(0));
    inputs_[0].assign(kControllerInputs, prior_exposure);
    for (int bin = 0; bin < kControllerGrid; ++bin) {
        Real *mean = bins_.data() + bin * kControllerChannels, encoded[kEncoded];
        const int column = bin % kControllerBins, row = bin / kControllerBins;
        for (int y = controller_bin_begin(row, rows); y < controller_bin_end(row, rows); ++y)
            for (int c = 0; c < kControllerChannels; ++c)
                mean[c] += row_sums_[std::size_t(y) * kRowValues + column * kControllerChannels + c];
        for (int c = 0; c < kControllerChannels; ++c) mean[c] /= Real(controller_bin_size(bin, columns, rows));
        linear(weights, controller_layer(2), mean, encoded);
        for (int c = 0; c < kEncoded; ++c) inputs_[0][c * kControllerGrid + bin] = encoded[c];
    }
    for (int k = 0; k < 3; ++k) {
        inputs_[k + 1].resize(kControllerHidden);
        linear(weights, controller_layer(3 + k), inputs_[k].data(), inputs_[k + 1].data());
        for (Real& x : inputs_[k + 1]) x = gs_max(x, Real(0));
    }
    linear(weights, controller_layer(6), inputs_[3].data(), out);
}

template <class Real>
void Controller<Real>::backward(const Real* weights, const Real* image, const Real* dL_dout, Real* dL_dweights) {
    std::fill(dL_dweights, dL_dweights + kControllerWeights, Real(0));
    if (!controller_sees(width_, height_)) return;
    const int columns = controller_blocks(width_), rows = controller_blocks(height_);
    std::vector<Real> dL_dlayer(dL_dout, dL_dout + kIspFrameValues);
    for (int k = 3; k >= 0; --k) {
        std::vector<Real> dL_din(inputs_[k].size(), Real(0));
        linear_backward(weights, controller_layer(3 + k), inputs_[k].data(), dL_dlayer.data(), dL_din.data(),
                        dL_dweights);
        for (std::size_t i = 0; k > 0 && i < dL_din.size(); ++i)
            if (!(inputs_[k][i] > Real(0))) dL_din[i] = 0;
        dL_dlayer = std::move(dL_din);
    }
    std::vector<Real> dL_dbins(kControllerGrid * kControllerChannels, Real(0));  // gradients of the sums over bins
    for (int bin = 0; bin < kControllerGrid; ++bin) {
        Real dL_dencoded[kEncoded], *dL_dmean = dL_dbins.data() + bin * kControllerChannels;
        for (int c = 0; c < kEncoded; ++c) dL_dencoded[c] = dL_dlayer[c * kControllerGrid + bin];
        linear_backward(weights, controller_layer(2), bins_.data() + bin * kControllerChannels, dL_dencoded, dL_dmean,
                        dL_dweights);
        for (int c = 0; c < kControllerChannels; ++c) dL_dmean[c] /= Real(controller_bin_size(bin, columns, rows));
    }
    row_gradients_.assign(std::size_t(rows) * kControllerBlockWeights, Real(0));
    parallel_for(rows, [&](std::int64_t y) {
        ControllerFeatures<Real> f;
        for (int x = 0; x < columns; ++x) {
            Real dL_dfeatures[kControllerChannels] = {};
            for (int bin = 0; bin < kControllerGrid; ++bin) {
                if (!controller_bin_has(bin % kControllerBins, columns, x) ||
                    !controller_bin_has(bin / kControllerBins, rows, int(y)))
                    continue;
                for (int c = 0; c < kControllerChannels; ++c)
                    dL_dfeatures[c] += dL_dbins[bin * kControllerChannels + c];
            }
            const ControllerBlock<Real> block = controller_block(image, width_, height_, x, int(y));
            controller_features(weights, block, f);
            controller_features_backward(weights, block, f, dL_dfeatures,
                                         row_gradients_.data() + y * kControllerBlockWeights);
        }
    });
    for (int k = 0; k < kControllerBlockWeights; ++k) {
        double sum = 0;
        for (int y = 0; y < rows; ++y) sum += row_gradients_[std::size_t(y) * kControllerBlockWeights + k];
        dL_dweights[k] = Real(sum);
    }
}

template class Controller<float>;
template class Controller<double>;

void initialize_controller(PpispState& state, std::uint64_t seed) {
    state.controller_step = 0;
    state.controller.resize(std::size_t(state.num_cameras) * kControllerWeights);
    state.controller_m.clear(), state.controller_v.clear();
    for (int camera = 0; camera < state.num_cameras; ++camera) {
        float* weights = state.controller.data() + std::size_t(camera) * kControllerWeights;
        for (int k = 0; k < kControllerLayers; ++k) {
            const ControllerLayer layer = controller_layer(k);
            const float bound = 1 / std::sqrt(float(layer.inputs));
            for (int i = layer.offset; i < layer.bias() + layer.outputs; ++i) {
                const Philox4 random =
                    philox(seed, RngStream::kController, std::uint64_t(camera), std::uint32_t(i / 4));
                weights[i] = bound * (2 * uniform_from_bits(random.v[i % 4]) - 1);
            }
        }
    }
}

}  // namespace gs
