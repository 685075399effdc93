// SPDX-License-Identifier: Apache-2.0
// The interface that every appearance model implements.
//
// colour = phi(base + residual(direction)); the direction is the unit vector from the camera centre to the Gaussian's
// mean (docs/math/appearance.md#composition). To add a model, add one folder `appearance/<name>/` with
//
//  1. `<name>.h`: `struct gs::appearance::<Name>` with static constexpr int kMaxResidual;                 largest
//     number of residual parameters per Gaussian static constexpr bool kDirectional;                false: no residual,
//     and no residual code is compiled residual(params, direction, active_degree)         -> Vec3<T>
//     residual_backward(params, direction, active_degree, dL_dresidual, dL_dparams, dL_ddirection) Both functions are
//     GS_HD templates over the scalar T; they allocate nothing and throw nothing. The caller zeroes `dL_dparams`, and
//     the model writes only the entries of active parameters. A model whose Gaussians share weights (a small network)
//     also has static constexpr int kNumShared;                   floats of all weights Its functions take `const T*
//     shared` first. The backward function also takes `T* dL_dshared` last and adds to it. Weights stay within
//     +-kLargestSharedWeight. On CUDA such a model defines how a warp evaluates it (`<name>_cuda.cuh`,
//     appearance/warp_appearance_cuda.cuh).
//  2. `model.cpp`: `const ModelInfo& gs::appearance::<name>_info()`, the facts that the host needs (model_info.h). They
//     include the degenerate cases for the stability measurement (StabilityPlan in model_info.h), the model's own
//     training options (model_option.h) and the functions that write and read viewers' files (packing.h).
//  3. `README.md` with equation, source and deviations, and `<name>_test.cpp` for the properties special to this model.
//  4. `model.cmake`: the line `gs_add_appearance(<name> <StructName>)`. A folder may hold several models of one family.
//     Each has such a line and an info function, and the header named like the folder holds all structs. A model that
//     only varies another one has `gs_add_appearance_variant` instead, and can be left out of a build.
//  5. `packing.json`: number, header fields and textures in viewers' files, for the program and the viewer alike
//     (PackingDescription in packing.h); a `Packing`, which fills them from a trained model (packing.h); and
//     `<name>.glsl`, which computes the residual from the file's texels (apps/viewer/README.md).
//
// CMake finds the folder and generates the registry. Command line, checkpoints, PLY columns, docs and the conformance
// tests follow from it.
#pragma once

#include "kernels/base/appearance_spec.h"
#include "kernels/base/portable.h"
#include "kernels/base/vec.h"

namespace gs::appearance {

// Limits on raw parameters whose gradients let a parameter return from beyond the limit
// (docs/math/appearance.md#clamps).

/// Returns min(raw, limit). NaN stays NaN, which gs_min(raw, limit) would turn into the limit.
template <class T> GS_HD T at_most(T raw, T limit) { return gs_min(limit, raw); }
template <class T> GS_HD T at_least(T raw, T limit) { return gs_max(limit, raw); }

/// Returns the gradient of a parameter clamped by at_most: 0 only if the optimizer would raise the parameter further.
/// If the gradient were 0 on the whole flat part, a parameter that once overshot could never return.
template <class T> GS_HD T gradient_at_most(T gradient, T raw, T limit) {
    return raw >= limit && gradient < T(0) ? T(0) : gradient;
}
template <class T> GS_HD T gradient_at_least(T gradient, T raw, T limit) {
    return raw <= limit && gradient > T(0) ? T(0) : gradient;
}

}  // namespace gs::appearance

namespace gs {

/// The distance, in world units, below which a Gaussian is treated as being at the camera centre. There the direction
/// is undefined and its gradient is unbounded (docs/math/appearance.md#view-direction).
inline constexpr double kMinViewDistance = 1e-6;

/// The unit direction and inverse distance from the camera centre to a Gaussian's mean.
template <class T> struct ViewDirection {
    Vec3<T> unit;
    T inverse_distance;  ///< 1/|mean - camera|; 0 if the direction is undefined, which zeroes the pullback
};

template <class T> GS_HD ViewDirection<T> view_direction(const Vec3<T>& mean, const Vec3<T>& camera_position) {
    const Vec3<T> v = mean - camera_position;
    const T distance = gs_sqrt(dot(v, v));
    if (!(distance >= T(kMinViewDistance))) return {{T(0), T(0), T(1)}, T(0)};
    const T inverse = T(1) / distance;
    return {v * inverse, inverse};
}

/// Returns dL/dmean from dL/ddirection: (I - d d^T) g / |v|.
template <class T> GS_HD Vec3<T> direction_pullback(const ViewDirection<T>& d, const Vec3<T>& dL_ddirection) {
    return (dL_ddirection - d.unit * dot(d.unit, dL_ddirection)) * d.inverse_distance;
}

/// The limit to which the optimizer clamps shared weights. It is far above any trained weight, and products over a few
/// layers stay finite.
inline constexpr double kLargestSharedWeight = 1e4;

/// Number of weights shared by the Gaussians of a model.
template <class Model>
inline constexpr int kNumSharedOf = [] {
    if constexpr (requires { Model::kNumShared; })
        return Model::kNumShared;
    else
        return 0;
}();

/// Returns the residual of any model, which is 0 below degree 1. `shared` and `params` may be null if the model has
/// none.
template <class Model, class T>
GS_HD Vec3<T> model_residual(const T* shared, const T* params, const Vec3<T>& direction, int degree) {
    if constexpr (Model::kDirectional) {
        if (degree > 0) {
            if constexpr (kNumSharedOf<Model> != 0)
                return Model::residual(shared, params, direction, degree);
            else
                return Model::residual(params, direction, degree);
        }
    }
    return {T(0), T(0), T(0)};
}

/// Computes the gradients of model_residual(). The caller zeroes `dL_dparams`; the function adds to `dL_dshared`.
template <class Model, class T>
GS_HD void model_residual_backward(const T* shared, const T* params, const Vec3<T>& direction, int degree,
                                   const Vec3<T>& dL_dresidual, T* dL_dparams, Vec3<T>& dL_ddirection, T* dL_dshared) {
    dL_ddirection = {T(0), T(0), T(0)};
    if constexpr (Model::kDirectional) {
        if (degree <= 0) return;
        if constexpr (kNumSharedOf<Model> != 0)
            Model::residual_backward(shared, params, direction, degree, dL_dresidual, dL_dparams, dL_ddirection,
                                     dL_dshared);
        else
            Model::residual_backward(params, direction, degree, dL_dresidual, dL_dparams, dL_ddirection);
    }
}

/// The largest colour value. With this value the faintest visible fragment (alpha 1/255) is white. The loss squares
/// colours twice, so one Gaussian of 1e10 would make the loss of every view that shows it infinite. A colour of 1e4
/// leaves second moments in Adam that slow all Gaussians in front of it for thousands of steps.
inline constexpr double kLargestColor = 255;

/// Returns phi(y), the colour of a pre-activation colour, at most kLargestColor
/// (docs/math/appearance.md#colour-activation). NaN stays NaN.
template <class T> GS_HD T color_activation(ColorActivation kind, T y) {
    switch (kind) {
        case ColorActivation::kRelu:
            return y + T(0.5) < T(0) ? T(0) : gs_min(T(kLargestColor), y + T(0.5));
        case ColorActivation::kSoftplus: {
            const T u =
                y + T(0.5);  // each term is divided by 10: 10 u may overflow, which only the exponential tolerates
            return gs_min(T(kLargestColor), gs_max(u, T(0)) + gs_log1p(gs_exp(T(-10) * gs_abs(u))) / T(10));
        }
        case ColorActivation::kSigmoid:
            return sigmoid(T(4) * y);
        case ColorActivation::kHardSigmoid: {
            const T u = y + T(0.5);
            return u < T(0) ? T(0) : (u > T(1) ? T(1) : u);
        }
    }
    return y;
}

template <class T> GS_HD Vec3<T> activate(ColorActivation kind, const Vec3<T>& y) {
    return {color_activation(kind, y.x), color_activation(kind, y.y), color_activation(kind, y.z)};
}

/// Returns phi'(y), computed from y: a computation from the stored colour would cancel near saturation
/// (docs/math/appearance.md#colour-activation). It ignores the limit kLargestColor, so that a colour above the limit
/// can return.
template <class T> GS_HD T color_activation_derivative(ColorActivation kind, T y) {
    switch (kind) {
        case ColorActivation::kRelu:
            return y > T(-0.5) ? T(1) : T(0);
        case ColorActivation::kSoftplus:
            return sigmoid(T(10) * (y + T(0.5)));
        case ColorActivation::kSigmoid:
            return T(4) * sigmoid(T(4) * y) * sigmoid(T(-4) * y);
        case ColorActivation::kHardSigmoid:
            return y > T(-0.5) && y < T(0.5) ? T(1) : T(0);
    }
    return T(1);
}

/// Returns phi^-1(color), the base colour that gives `color`. The colour is first clamped to half an 8-bit step from 0
/// and 1, where the gradient of every activation but softplus would vanish (docs/math/appearance.md#initial-colour).
template <class T> GS_HD T inverse_color_activation(ColorActivation kind, T color) {
    const T c = gs_clamp(color, T(0.5 / 255), T(1 - 0.5 / 255));
    switch (kind) {
        case ColorActivation::kRelu:
        case ColorActivation::kHardSigmoid:
            return c - T(0.5);
        case ColorActivation::kSoftplus:
            return gs_log(gs_expm1(T(10) * c)) / T(10) - T(0.5);
        case ColorActivation::kSigmoid:
            return gs_log(c / (T(1) - c)) / T(4);
    }
    return c;
}

}  // namespace gs
