// SPDX-License-Identifier: Apache-2.0
// What the host knows of the neural models: parameters, learning rates, first values.
#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "appearance/neural/neural.h"
#include "appearance/neural/packing.h"
#include "appearance/neural/stability.h"
#include "kernels/base/rng.h"

namespace gs::appearance {
namespace {

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
    // Without the products, for which GPUs have other units: encoding, activations, tanh; on the way back both and
    // their chain rule.
    m.operations = 20 * Model::kEncoded / 2 + 40 + Model::kLayers * Model::kNeurons + 60,
    m.operations_backward = 2 * m.operations;
    m.default_max_degree = m.max_degree_limit = 3;
    m.residual_width = [](int degree) { return degree > 0 ? Model::kFeatures : 0; };
    m.rates = [](int, const RateContext&) {
        // Constant to iteration 7000, then half a cosine that would reach 0 at 37 000.
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
