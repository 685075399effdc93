// SPDX-License-Identifier: Apache-2.0
// Code common to the CPU and CUDA controllers (docs/math/ppisp.md#controller): the layout of the weights, the blocks of
// each bin, and the layers that process single blocks of pixels.
//
// The convolution to 64 channels is linear and followed by a mean. It is therefore applied to the 25 means of 32
// channels instead of to all blocks. The result is the same up to rounding, and the widest layer does not run on every
// block.
#pragma once

#include <cstddef>

#include "kernels/base/portable.h"
#include "kernels/state/ppisp_state.h"

namespace gs {

/// The position of a layer's values: weights (outputs, inputs), row-major from `offset`, then biases.
struct ControllerLayer {
    int offset, inputs, outputs;
    GS_HD constexpr int bias() const { return offset + inputs * outputs; }
};

inline constexpr int kControllerLayers = 7;
/// Returns a layer. Layers 0..2 process blocks and bins, 3..5 the whole image; layer 6 outputs exposure and colour
/// latents.
GS_HD constexpr ControllerLayer controller_layer(int layer) {
    const int inputs[kControllerLayers] = {
        3, 16, 32, kControllerInputs, kControllerHidden, kControllerHidden, kControllerHidden};
    const int outputs[kControllerLayers] = {
        16, 32, 64, kControllerHidden, kControllerHidden, kControllerHidden, kIspFrameValues};
    int offset = 0;
    for (int k = 0; k < layer; ++k) offset += layer_weights(inputs[k], outputs[k]);
    return {offset, inputs[layer], outputs[layer]};
}
static_assert(controller_layer(6).bias() + kIspFrameValues == kControllerWeights);

inline constexpr int kControllerGrid = kControllerBins * kControllerBins;
/// Number of channels after the first and after the second layer.
inline constexpr int kControllerHiddenChannels = kControllerConv[1], kControllerChannels = kControllerConv[2];
/// Number of weights of the block layers, which come first.
inline constexpr int kControllerBlockWeights = controller_layer(2).offset;

/// Returns the number of blocks along a side of `pixels`. Remaining pixels at its end are ignored.
GS_HD constexpr int controller_blocks(int pixels) { return pixels / kControllerPool; }
/// Returns whether an image contains at least one block. Otherwise the controller's values are 0.
GS_HD constexpr bool controller_sees(int width, int height) {
    return controller_blocks(width) > 0 && controller_blocks(height) > 0;
}
/// Returns the bounds [begin, end) of bin `bin` along a side of n blocks. Neighbouring bins overlap by one block unless
/// 5 divides n. With fewer than 5 blocks, blocks are repeated.
GS_HD constexpr int controller_bin_begin(int bin, int n) { return bin * n / kControllerBins; }
GS_HD constexpr int controller_bin_end(int bin, int n) {
    return ((bin + 1) * n + kControllerBins - 1) / kControllerBins;
}
GS_HD constexpr bool controller_bin_has(int bin, int n, int block) {
    return controller_bin_begin(bin, n) <= block && block < controller_bin_end(bin, n);
}
/// Returns the number of blocks in bin `bin` (row-major) of an image of columns x rows blocks.
GS_HD constexpr int controller_bin_size(int bin, int columns, int rows) {
    const int x = bin % kControllerBins, y = bin / kControllerBins;
    return (controller_bin_end(x, columns) - controller_bin_begin(x, columns)) *
           (controller_bin_end(y, rows) - controller_bin_begin(y, rows));
}

/// A block of pixels of a planar image.
template <class Real> struct ControllerBlock {
    const Real* corner;  ///< first channel of the first pixel
    std::ptrdiff_t row, plane;

    GS_HD Real at(int channel, int pixel) const {
        return corner[channel * plane + pixel / kControllerPool * row + pixel % kControllerPool];
    }
};

/// Returns block (x, y), counted in blocks, of a planar (3,H,W) image.
template <class Real>
GS_HD ControllerBlock<Real> controller_block(const Real* image, int width, int height, int x, int y) {
    return {image + std::ptrdiff_t(kControllerPool) * y * width + kControllerPool * x, width,
            std::ptrdiff_t(width) * height};
}

/// Evaluates an output of the first layer. Returns its maximum over the block, and sets `pixel` to the first pixel with
/// this value.
template <class Real>
GS_HD Real controller_strongest(const Real* weights, const ControllerBlock<Real>& block, int output, int& pixel) {
    constexpr ControllerLayer layer = controller_layer(0);
    const Real* w = weights + layer.offset + output * layer.inputs;
    Real largest = 0;
    for (int p = 0; p < kControllerPool * kControllerPool; ++p) {
        const Real value = w[0] * block.at(0, p) + w[1] * block.at(1, p) + w[2] * block.at(2, p);
        if (p == 0 || value > largest) largest = value, pixel = p;
    }
    return largest + weights[layer.bias() + output];
}

/// The activations of one block.
template <class Real> struct ControllerFeatures {
    Real hidden[kControllerHiddenChannels], out[kControllerChannels];  ///< both after ReLU
    /// Pixel with the maximum of each hidden channel.
    int pixel[kControllerHiddenChannels];
};

template <class Real>
GS_HD void controller_features(const Real* weights, const ControllerBlock<Real>& block, ControllerFeatures<Real>& f) {
    constexpr ControllerLayer layer = controller_layer(1);
    for (int k = 0; k < layer.inputs; ++k)
        f.hidden[k] = gs_max(controller_strongest(weights, block, k, f.pixel[k]), Real(0));
    for (int c = 0; c < layer.outputs; ++c) {
        Real sum = weights[layer.bias() + c];
        for (int k = 0; k < layer.inputs; ++k) sum += weights[layer.offset + c * layer.inputs + k] * f.hidden[k];
        f.out[c] = gs_max(sum, Real(0));
    }
}

/// Adds the gradients of the first kControllerBlockWeights weights to dL_dweights, given dL/d(f.out).
template <class Real>
GS_HD void controller_features_backward(const Real* weights, const ControllerBlock<Real>& block,
                                        const ControllerFeatures<Real>& f, const Real* dL_dfeatures,
                                        Real* dL_dweights) {
    constexpr ControllerLayer first = controller_layer(0), second = controller_layer(1);
    Real dL_dhidden[kControllerHiddenChannels] = {};
    for (int c = 0; c < second.outputs; ++c) {
        if (!(f.out[c] > Real(0))) continue;
        const Real g = dL_dfeatures[c];
        dL_dweights[second.bias() + c] += g;
        for (int k = 0; k < second.inputs; ++k) {
            dL_dweights[second.offset + c * second.inputs + k] += g * f.hidden[k];
            dL_dhidden[k] += g * weights[second.offset + c * second.inputs + k];
        }
    }
    for (int k = 0; k < first.outputs; ++k) {
        if (!(f.hidden[k] > Real(0))) continue;
        dL_dweights[first.bias() + k] += dL_dhidden[k];
        for (int c = 0; c < first.inputs; ++c)
            dL_dweights[first.offset + k * first.inputs + c] += dL_dhidden[k] * block.at(c, f.pixel[k]);
    }
}

}  // namespace gs
