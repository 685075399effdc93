// SPDX-License-Identifier: Apache-2.0
// Neural: a few features per Gaussian and one small network for all of them.
#pragma once

#include <type_traits>

#include "appearance/contract.h"
#include "appearance/sh_basis.h"
#include "kernels/base/lanes.h"
#include "kernels/base/spherical_harmonics.h"

namespace gs::appearance {

/// One value per neuron, for device code and for scalar types without vector instructions.
template <class T, int kWidth> struct ScalarNeurons {
    T v[kWidth];

    static GS_HD ScalarNeurons zero() {
        ScalarNeurons n;
        GS_UNROLL
        for (int i = 0; i < kWidth; ++i) n.v[i] = T(0);
        return n;
    }
    /// Adds weights * x to the values.
    GS_HD void add(const T* weights, T x) {
        GS_UNROLL
        for (int i = 0; i < kWidth; ++i) v[i] = gs_fma(weights[i], x, v[i]);
    }
    /// Returns the product of a row of weights with the values.
    GS_HD T dot(const T* weights) const {
        T s = T(0);
        GS_UNROLL
        for (int i = 0; i < kWidth; ++i) s = gs_fma(weights[i], v[i], s);
        return s;
    }
    /// Adds the values times x to a row.
    GS_HD void add_to(T* row, T x) const {
        GS_UNROLL
        for (int i = 0; i < kWidth; ++i) row[i] = gs_fma(v[i], x, row[i]);
    }
    GS_HD void relu() {
        GS_UNROLL
        for (int i = 0; i < kWidth; ++i) v[i] = gs_max(T(0), v[i]);  // NaN stays NaN in this order
    }
    GS_HD T operator[](int i) const { return v[i]; }
    GS_HD void set(int i, T x) { v[i] = x; }
};

#ifdef __CUDACC__
template <class T, int kWidth> using Neurons = ScalarNeurons<T, kWidth>;
#else

/// One value per neuron in vectors of 16, with the operations of ScalarNeurons.
template <class T, int kWidth> struct LaneNeurons {
    static constexpr int kVectors = kWidth / kLanes;
    Lanes<T> v[kVectors];

    static GS_HD LaneNeurons zero() {
        LaneNeurons n;
        for (int k = 0; k < kVectors; ++k) n.v[k] = Lanes<T>(T(0));
        return n;
    }
    GS_HD void add(const T* weights, T x) {
        for (int k = 0; k < kVectors; ++k) v[k] = gs_fma(Lanes<T>::load(weights + kLanes * k), Lanes<T>(x), v[k]);
    }
    GS_HD T dot(const T* weights) const {
        Lanes<T> s = Lanes<T>::load(weights) * v[0];
        for (int k = 1; k < kVectors; ++k) s = gs_fma(Lanes<T>::load(weights + kLanes * k), v[k], s);
        return sum_lanes(s);
    }
    GS_HD void add_to(T* row, T x) const {
        for (int k = 0; k < kVectors; ++k)
            gs_fma(v[k], Lanes<T>(x), Lanes<T>::load(row + kLanes * k)).store(row + kLanes * k);
    }
    GS_HD void relu() {
        for (int k = 0; k < kVectors; ++k) v[k] = lane_max(Lanes<T>(T(0)), v[k]);
    }
    GS_HD T operator[](int i) const { return v[i / kLanes][i % kLanes]; }
    GS_HD void set(int i, T x) { v[i / kLanes].set(i % kLanes, x); }
};

template <class T, int kWidth>
using Neurons = std::conditional_t<(std::is_same_v<T, float> || std::is_same_v<T, double>)&&kWidth % kLanes == 0,
                                   LaneNeurons<T, kWidth>, ScalarNeurons<T, kWidth> >;

#endif

/// The limit of features that enter the network without encoding, so that products with weights over a few layers stay
/// finite. The gradient is not clamped, so that a feature beyond the limit can return.
inline constexpr double kLargestFeature = 1e4;

/// Computes sine and cosine of the encoding at full precision.
struct ExactSinCos {
    template <class T> GS_HD void operator()(T x, T& s, T& c) const { gs_sincos(x, s, c); }
};

/// residual(d) = tanh(W_out relu(... relu(W_0 x))), x = [encoded features, SH basis of d to degree 3]. There are no
/// biases; the constant of band 0 serves as one. Features are encoded as sin(2^j f), cos(2^j f), j < kFrequencies, or
/// enter without encoding if kFrequencies is 0.
///
/// The shared weights are W_0 as (kInputs, kNeurons), the hidden matrices as (from, to), and the output as (3,
/// kNeurons). Every row holds the weights of all neurons of a layer.
template <int kFeatureCount, int kFrequencyCount, int kHiddenLayers, int kNeuronCount> struct NeuralResidual {
    static constexpr int kFeatures = kFeatureCount, kFrequencies = kFrequencyCount, kLayers = kHiddenLayers,
                         kNeurons = kNeuronCount;
    static constexpr int kMaxResidual = kFeatures;
    static constexpr bool kDirectional = true;
    static constexpr int kEncoded = kFrequencies > 0 ? 2 * kFrequencies* kFeatures : kFeatures;
    static constexpr int kBases = 16;
    static constexpr int kInputs = kEncoded + kBases;
    static constexpr int kFirstOutput = kInputs * kNeurons + (kLayers - 1) * kNeurons * kNeurons;
    static constexpr int kNumShared = kFirstOutput + 3 * kNeurons;

    /// Returns the offset of the matrix into hidden layer `layer`.
    static GS_HD constexpr int matrix(int layer) {
        return layer == 0 ? 0 : kInputs * kNeurons + (layer - 1) * kNeurons * kNeurons;
    }
    /// Returns the number of inputs in use; the inputs of bands above `degree` are 0.
    static GS_HD constexpr int active_inputs(int degree) { return kEncoded + (degree + 1) * (degree + 1); }

    template <class T, class SinCos = ExactSinCos>
    static GS_HD void encode(const T* features, const Vec3<T>& direction, int degree, T* x, SinCos sin_cos = {}) {
        GS_UNROLL
        for (int i = 0; i < kFeatures; ++i) {
            if constexpr (kFrequencies == 0)
                x[i] = at_least(at_most(features[i], T(kLargestFeature)), T(-kLargestFeature));
            GS_UNROLL
            for (int j = 0; j < kFrequencies; ++j)
                sin_cos(T(1 << j) * features[i], x[2 * (kFrequencies * i + j)], x[2 * (kFrequencies * i + j) + 1]);
        }
        x[kEncoded] = T(kY0);
        GS_UNROLL
        for (int k = 1; k < kBases; ++k) x[kEncoded + k] = T(0);
        ShBasis::basis(direction, degree, x + kEncoded + 1);
    }

    /// Computes the gradient of the features from that of their encoding.
    template <class T> static GS_HD void encode_backward(const T* x, const T* dL_dx, T* dL_dfeatures) {
        GS_UNROLL
        for (int i = 0; i < kFeatures; ++i) {
            if constexpr (kFrequencies == 0) {
                dL_dfeatures[i] = dL_dx[i];
            } else {
                T sum = T(0);
                GS_UNROLL
                for (int j = 0; j < kFrequencies; ++j) {
                    const int s = 2 * (kFrequencies * i + j), c = s + 1;
                    sum += T(1 << j) * (x[c] * dL_dx[s] - x[s] * dL_dx[c]);
                }
                dL_dfeatures[i] = sum;
            }
        }
    }

    /// The activations of one forward pass.
    template <class T> struct Pass {
        using Layer = Neurons<T, kNeurons>;
        T x[kInputs];
        Layer hidden[kLayers];
        Vec3<T> output;  ///< output before tanh

        GS_HD Pass(const T* shared, const T* features, const Vec3<T>& direction, int degree) {
            encode(features, direction, degree, x);
            for (int layer = 0; layer < kLayers; ++layer) {
                const T* w = shared + matrix(layer);
                Layer sum = Layer::zero();
                if (layer == 0) {
                    for (int j = 0, n = active_inputs(degree); j < n; ++j) sum.add(w + j * kNeurons, x[j]);
                } else {
                    for (int j = 0; j < kNeurons; ++j) sum.add(w + j * kNeurons, hidden[layer - 1][j]);
                }
                sum.relu();
                hidden[layer] = sum;
            }
            const T* w = shared + kFirstOutput;
            const Layer& last = hidden[kLayers - 1];
            output = {last.dot(w), last.dot(w + kNeurons), last.dot(w + 2 * kNeurons)};
        }
    };

    template <class T>
    static GS_HD Vec3<T> residual(const T* shared, const T* params, const Vec3<T>& direction, int degree) {
        if (degree <= 0) return {T(0), T(0), T(0)};
        const Vec3<T> o = Pass<T>(shared, params, direction, degree).output;
        return {gs_tanh(o.x), gs_tanh(o.y), gs_tanh(o.z)};
    }

    template <class T>
    static GS_HD void residual_backward(const T* shared, const T* params, const Vec3<T>& direction, int degree,
                                        const Vec3<T>& dL_dresidual, T* dL_dparams, Vec3<T>& dL_ddirection,
                                        T* dL_dshared) {
        dL_ddirection = {T(0), T(0), T(0)};
        if (degree <= 0) return;
        const Pass<T> p(shared, params, direction, degree);
        using Layer = Neurons<T, kNeurons>;
        const Vec3<T>& o = p.output;
        const T delta_out[3] = {tanh_derivative(o.x) * dL_dresidual.x, tanh_derivative(o.y) * dL_dresidual.y,
                                tanh_derivative(o.z) * dL_dresidual.z};
        Layer delta = Layer::zero();
        for (int c = 0; c < 3; ++c) {
            delta.add(shared + kFirstOutput + c * kNeurons, delta_out[c]);
            p.hidden[kLayers - 1].add_to(dL_dshared + kFirstOutput + c * kNeurons, delta_out[c]);
        }
        delta = masked(delta, p.hidden[kLayers - 1]);
        for (int layer = kLayers - 1; layer > 0; --layer) {
            const T* w = shared + matrix(layer);
            T* dw = dL_dshared + matrix(layer);
            Layer before = Layer::zero();
            for (int j = 0; j < kNeurons; ++j) {
                const T h = p.hidden[layer - 1][j];
                if (!(h > T(0))) continue;  // an inactive neuron neither passes on a gradient nor receives one
                before.set(j, delta.dot(w + j * kNeurons));
                delta.add_to(dw + j * kNeurons, h);
            }
            delta = before;
        }
        T dL_dx[kInputs] = {};
        for (int j = 0, n = active_inputs(degree); j < n; ++j) {
            dL_dx[j] = delta.dot(shared + j * kNeurons);
            delta.add_to(dL_dshared + j * kNeurons, p.x[j]);
        }
        encode_backward(p.x, dL_dx, dL_dparams);
        dL_ddirection = ShBasis::basis_gradient(direction, degree, dL_dx + kEncoded + 1);
    }

  private:
    /// Returns delta for active neurons and 0 for the others. The derivative of ReLU at 0 is 0.
    template <class Layer> static GS_HD Layer masked(const Layer& delta, const Layer& activation) {
        Layer out = delta;
        for (int j = 0; j < kNeurons; ++j)
            if (!(activation[j] > 0)) out.set(j, 0);
        return out;
    }
};

using Neural = NeuralResidual<8, 1, 2, 16>;
// The variants of the paper's ablation.
using NeuralOneLayer = NeuralResidual<8, 1, 1, 16>;
using NeuralThreeLayers = NeuralResidual<8, 1, 3, 16>;
using NeuralWide = NeuralResidual<8, 1, 2, 32>;
using NeuralPlain = NeuralResidual<16, 0, 2, 16>;

}  // namespace gs::appearance
