// SPDX-License-Identifier: Apache-2.0
// Host-side description of the neural models: parameters, learning rates, initial values, packing for viewers, and
// degenerate cases for the stability measurement.
#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "appearance/neural/neural.h"
#include "appearance/packing.h"
#include "kernels/base/rng.h"

namespace gs::appearance {
namespace {

// Networks in files for viewers: per Gaussian the first layer's view-independent sums, or its encoded features if these
// are fewer; weights as halves (docs/formats.md#scenengsplat).

constexpr int kMaxBand = 3;       // of the 6 that packing.json allows
constexpr int kMaxNeurons = 256;  // as in packing.json

constexpr int padded(int n) { return (n + 3) / 4 * 4; }

/// Returns the number of directional inputs of the first layer: the basis functions of all bands in `bands`.
int num_directional(const PackedHeader& header) {
    int n = 0;
    for (int band = 1; band <= kMaxBand; ++band) n += (header.bands >> band & 1) ? 2 * band + 1 : 0;
    return n;
}

/// Returns the number of inputs whose weights are stored. A folded layer has only the directional inputs.
int num_inputs(const PackedHeader& header) {
    const int other = header.folded ? 0 : int(header.features) + (header.constant_input ? 1 : 0);
    return other + num_directional(header);
}

int num_halves(const PackedHeader& header) { return int(header.folded ? header.neurons : header.features); }

/// Returns the position of W[output][input], for a layer with `outputs` outputs, in the layer's part of the stream:
/// four inputs per texel, with the texels of all outputs before the next four inputs.
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
    // Inputs in the model's order: features, Y_0, then the bands; bands above the active degree have zero weights.
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
    if (g[Group::kResidual].width == 0) return;  // degree 0: only the base colour
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

/// Returns the packing of a network of neural.h.
template <class Model> const Packing& network_packing() {
    static const Packing packing{&packing_description("neural"), prepare<Model>, pack_row<Model>, residual};
    return packing;
}
template const Packing& network_packing<Neural>();
template const Packing& network_packing<NeuralOneLayer>();
template const Packing& network_packing<NeuralThreeLayers>();
template const Packing& network_packing<NeuralWide>();
template const Packing& network_packing<NeuralPlain>();

/// Returns features, then weights. All inner weights are `inner` (0: sine waves of both signs), and all output weights
/// are `output` with one sign per channel.
template <class Model> std::vector<double> network(double inner, double output) {
    std::vector<double> numbers(Model::kMaxResidual + Model::kNumShared);
    double* weights = numbers.data() + Model::kMaxResidual;
    for (int k = 0; k < Model::kMaxResidual; ++k) numbers[k] = std::sin(k + 1.0);
    for (int k = 0; k < Model::kFirstOutput; ++k) weights[k] = inner != 0 ? inner : 0.3 * std::sin(0.7 * k * k);
    for (int k = Model::kFirstOutput; k < Model::kNumShared; ++k)
        weights[k] = (k - Model::kFirstOutput) / Model::kNeurons % 2 ? output : -output;
    return numbers;
}

/// Returns cases with neurons at exactly 0, all off, and all on; with outputs saturated with either sign; with weights
/// at their limit.
template <class Model> StabilityPlan network_stability() {
    StabilityPlan plan;
    plan.column_kinds.assign(Model::kMaxResidual, "features");
    const std::array<double, 3> views[] = {{0.3, 0.8, -0.4}, {-0.5, -0.2, 0.9}, {0, 0, 1}, {1e-8, 1, 0}};
    for (const auto& view : views) {
        // Inner weights of 0 put every neuron exactly at the kink of ReLU.
        auto corner = network<Model>(0, 0.5);
        std::fill(corner.begin() + Model::kMaxResidual, corner.begin() + Model::kMaxResidual + Model::kFirstOutput,
                  0.0);
        plan.cases.push_back({"neurons at 0", corner, view, std::array<double, 3>{}, "residual"});
        for (const double inner : {-1e4, -0.2, 0.2, 1e4})
            plan.cases.push_back({"neurons all off or on", network<Model>(inner, 0.1), view, {}, {}});
        // Outputs range from ordinary values through |o| = 9, where tanh is 1 in float, to far beyond 43, where its
        // slope underflows.
        for (const double output : {0.5, 2., 5., 10., 20., 40., 100., 1e4})
            plan.cases.push_back({"saturated output", network<Model>(0, output), view, {}, {}});
    }
    return plan;
}

template StabilityPlan network_stability<Neural>();
template StabilityPlan network_stability<NeuralOneLayer>();
template StabilityPlan network_stability<NeuralThreeLayers>();
template StabilityPlan network_stability<NeuralWide>();
template StabilityPlan network_stability<NeuralPlain>();

/// Draws weights uniformly from +-sqrt(6 / (inputs + outputs)) (Glorot). The output matrix becomes 0, so that training
/// starts at the base colour. The random layers break the symmetry between neurons.
template <class Model> void init_weights(std::uint64_t seed, float* weights) {
    std::fill_n(weights, Model::kNumShared, 0.0f);
    for (int layer = 0; layer < Model::kLayers; ++layer) {
        const int inputs = layer == 0 ? Model::kInputs : Model::kNeurons;
        const float bound = float(std::sqrt(6.0 / (inputs + Model::kNeurons)));
        for (int k = 0; k < inputs * Model::kNeurons; ++k) {
            const int at = Model::matrix(layer) + k;
            weights[at] =
                bound * (2 * uniform_from_bits(philox(seed, RngStream::kInitWeights, std::uint64_t(at), 0).v[0]) - 1);
        }
    }
}

template <class Model> ModelInfo make_info(const char* name, const char* summary) {
    ModelInfo m;
    m.name = name;
    m.summary = summary;
    m.variant = m.name != "neural";  // of the paper's ablation
    // Excludes the matrix products, which run on other units of the GPU. Counts encoding, activations and tanh; the
    // backward pass counts both and their chain rule.
    m.operations = 20 * Model::kEncoded / 2 + 40 + Model::kLayers * Model::kNeurons + 60,
    m.operations_backward = 2 * m.operations;
    m.default_max_degree = m.max_degree_limit = 3;
    m.residual_width = [](int degree) { return degree > 0 ? Model::kFeatures : 0; };
    m.rates = [](int, const RateContext&) {
        // Constant until iteration 7000, then half a cosine that would reach 0 at 37 000.
        const auto decaying = [](double rate) { return Schedule::cosine(rate, 7000, 37000, 0, 1); };
        return AppearanceRates{decaying(0.00025), {decaying(0.008)}, Schedule::warm_up(0.003)};
    };
    m.init_residual = [](int degree, float* row) { std::fill_n(row, degree > 0 ? Model::kFeatures : 0, 0.0f); };
    m.num_shared = Model::kNumShared;
    m.init_shared = &init_weights<Model>;
    m.stability = network_stability<Model>;
    m.residual = &model_residual<Model, double>;
    m.packing = &network_packing<Model>();
    return m;
}

}  // namespace

const ModelInfo& neural_info() {
    static const ModelInfo info =
        make_info<Neural>("neural", "8 features per Gaussian and one network of two layers of 16 for all");
    return info;
}
const ModelInfo& neural_1layer_info() {
    static const ModelInfo info = make_info<NeuralOneLayer>("neural_1layer", "neural with one hidden layer");
    return info;
}
const ModelInfo& neural_3layers_info() {
    static const ModelInfo info = make_info<NeuralThreeLayers>("neural_3layers", "neural with three hidden layers");
    return info;
}
const ModelInfo& neural_wide_info() {
    static const ModelInfo info = make_info<NeuralWide>("neural_wide", "neural with layers of 32");
    return info;
}
const ModelInfo& neural_plain_info() {
    static const ModelInfo info =
        make_info<NeuralPlain>("neural_plain", "neural with 16 features, which enter the network as they are");
    return info;
}

}  // namespace gs::appearance
