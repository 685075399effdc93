// SPDX-License-Identifier: Apache-2.0
// The values of one layer's neurons, and the operations on whole rows of weights that make up a small network.
#pragma once

#include <type_traits>

#include "kernels/base/lanes.h"

namespace gs::appearance {

/// One value per neuron, for device code and for scalars without vectors.
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

/// One value per neuron in vectors of 16; the operations are those of ScalarNeurons.
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

}  // namespace gs::appearance
