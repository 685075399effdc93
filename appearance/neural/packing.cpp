// SPDX-License-Identifier: Apache-2.0
// Packs features and weights as viewers evaluate them, and evaluates colours from them.
#include "appearance/neural/packing.h"

#include <algorithm>

#include "appearance/neural/neural.h"

namespace gs::appearance {
namespace {

constexpr int kMaxBand = 3;       // of the 6 that packing.json allows
constexpr int kMaxNeurons = 256;  // as in packing.json

constexpr int padded(int n) { return (n + 3) / 4 * 4; }

/// Returns the number of directional inputs of the first layer: the basis functions of all bands in `bands`.
int num_directional(const PackedHeader& header) {
    int n = 0;
    for (int band = 1; band <= kMaxBand; ++band) n += (header.bands >> band & 1) ? 2 * band + 1 : 0;
    return n;
}

/// Returns the number of inputs whose weights are stored. A folded layer has the directional ones alone.
int num_inputs(const PackedHeader& header) {
    const int other = header.folded ? 0 : int(header.features) + (header.constant_input ? 1 : 0);
    return other + num_directional(header);
}

int num_halves(const PackedHeader& header) { return int(header.folded ? header.neurons : header.features); }

/// Where W[output][input] of a layer with that many outputs lies in the layer's part of the stream: four inputs to a
/// texel, texels of all outputs before the next four inputs.
constexpr std::int64_t weight_at(int outputs, int output, int input) {
    return (std::int64_t(input / 4) * outputs + output) * 4 + input % 4;
}

template <class Model> PackedAppearance prepare(const Gaussians& g) {
    constexpr int neurons = Model::kNeurons;
    PackedHeader header;
    header.model = packing_description("neural").id;
    header.features = Model::kEncoded;
    header.frequencies = Model::kFrequencies;
    header.bands = 0xe;
    header.activation = PackedResidualActivation::kTanh;
    header.neurons = neurons;
    header.hidden_layers = Model::kLayers;
    header.folded = neurons <= 16 && (neurons + 7) / 8 <= (Model::kEncoded + 7) / 8;
    PackedAppearance packed = make_packed(header, g);

    const float* shared = g.shared.param.data();
    std::uint16_t* out = packed.weights.data();
    // Inputs in the model's order: features, Y_0, then the bands; those above the active degree count for nothing.
    const int skipped = header.folded ? Model::kEncoded + 1 : 0, inputs = num_inputs(header);
    for (int i = 0; i < inputs && skipped + i < Model::active_inputs(g.active_degree); ++i) {
        for (int o = 0; o < neurons; ++o)
            out[weight_at(neurons, o, i)] = half_bits(shared[(skipped + i) * neurons + o]);
    }
    out += padded(inputs) * neurons;
    for (int layer = 1; layer < Model::kLayers; ++layer, out += neurons * neurons) {
        for (int i = 0; i < neurons; ++i) {
            for (int o = 0; o < neurons; ++o)
                out[weight_at(neurons, o, i)] = half_bits(shared[Model::matrix(layer) + i * neurons + o]);
        }
    }
    if (g.active_degree == 0) return packed;  // no output: the base colour
    for (int i = 0; i < neurons; ++i) {
        for (int o = 0; o < 3; ++o) out[weight_at(3, o, i)] = half_bits(shared[Model::kFirstOutput + o * neurons + i]);
    }
    return packed;
}

template <class Model> void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    if (g[Group::kResidual].width == 0) return;  // degree 0: nothing but the base colour
    double features[Model::kFeatures], x[Model::kInputs];
    std::copy_n(g[Group::kResidual].param.data() + row * Model::kFeatures, Model::kFeatures, features);
    Model::encode(features, Vec3<double>{0, 0, 1}, 0, x);
    if (!packed.header.folded) {
        for (int k = 0; k < Model::kEncoded; ++k) set_half(packed, row, k, x[k]);
        return;
    }
    for (int o = 0; o < Model::kNeurons; ++o) {
        double sum = 0;
        for (int k = 0; k <= Model::kEncoded; ++k)
            sum += double(g.shared.param[std::size_t(k * Model::kNeurons + o)]) * x[k];
        set_half(packed, row, o, sum);
    }
}

Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    const PackedHeader& header = packed.header;
    const int neurons = int(header.neurons);
    double x[kMaxHalves + 16], basis[15], hidden[kMaxNeurons] = {}, next[kMaxNeurons];
    int inputs = 0;
    for (int k = 0; k < num_halves(header); ++k) (header.folded ? hidden[k] : x[inputs++]) = get_half(packed, row, k);
    if (!header.folded && header.constant_input) x[inputs++] = kY0;
    ShBasis::basis(direction, kMaxBand, basis);
    for (int band = 1; band <= kMaxBand; ++band) {
        if (header.bands >> band & 1) inputs = int(std::copy_n(basis + band * band - 1, 2 * band + 1, x + inputs) - x);
    }
    const std::uint16_t* weights = packed.weights.data();
    const auto add_layer = [&](const double* in, int num_in, double* out, int num_out) {
        for (int i = 0; i < num_in; ++i) {
            for (int o = 0; o < num_out; ++o) out[o] += half_value(weights[weight_at(num_out, o, i)]) * in[i];
        }
        weights += padded(num_in) * num_out;
    };
    add_layer(x, inputs, hidden, neurons);
    for (std::uint32_t layer = 1; layer <= header.hidden_layers; ++layer) {
        const bool last = layer == header.hidden_layers;
        for (int o = 0; o < neurons; ++o) hidden[o] = std::max(0.0, hidden[o]), next[o] = 0;
        add_layer(hidden, neurons, next, last ? 3 : neurons);
        std::copy_n(next, last ? 3 : neurons, hidden);
    }
    return packed_activation(header.activation, {hidden[0], hidden[1], hidden[2]});
}

}  // namespace

template <class Model> const Packing& network_packing() {
    static const Packing packing{&packing_description("neural"), prepare<Model>, pack_row<Model>, residual};
    return packing;
}
template const Packing& network_packing<Neural>();
template const Packing& network_packing<NeuralOneLayer>();
template const Packing& network_packing<NeuralThreeLayers>();
template const Packing& network_packing<NeuralWide>();
template const Packing& network_packing<NeuralPlain>();

}  // namespace gs::appearance
