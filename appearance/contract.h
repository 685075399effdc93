// SPDX-License-Identifier: Apache-2.0
// The interface every appearance model fulfils.
//
// colour = phi(base + residual(direction)), direction = unit vector from the camera centre to the Gaussian's mean
// (docs/math/appearance.md#composition). To add a model, add one folder `appearance/<name>/` with
//
//  1. `<name>.h`: `struct gs::appearance::<Name>` with
//       static constexpr int kMaxResidual;                 upper bound of the residual's floats per Gaussian
//       static constexpr bool kDirectional;                false: no residual at all, nothing of it is compiled
//       residual(params, direction, active_degree)         -> Vec3<T>
//       residual_backward(params, direction, active_degree, dL_dresidual, dL_dparams, dL_ddirection)
//     both GS_HD templates over the scalar T; they allocate nothing and throw nothing. The caller zeroes `dL_dparams`;
//     only entries of active parameters are written;
//     A model whose Gaussians share weights (a small network) also has
//       static constexpr int kNumShared;                   floats of all weights
//     and its functions take `const T* shared` first and, backward, `T* dL_dshared` last, which they add to. Weights stay
//     within +-kLargestSharedWeight. On CUDA such a model says itself how a warp evaluates it (`<name>_cuda.cuh`,
//     appearance/warp_appearance_cuda.cuh);
//  2. `model.cpp`: `const ModelInfo& gs::appearance::<name>_info()`, the facts the host needs (model_info.h), among them the
//     degenerate cases for the stability measurement (stability_case.h), its own training options (model_option.h), and how
//     viewers' files hold it (packing.h);
//  3. `README.md`: equation, source, deviations; `<name>_test.cpp`: what is special to this model;
//  4. `model.cmake`: the line `gs_add_appearance(<name> <StructName>)`. A folder may hold several models of one family: one
//     such line and one info function each, the structs all in the header named like the folder. A model that only varies
//     another one has `gs_add_appearance_variant` instead, and can be left out of a build;
//  5. `packing.json`: its number, header fields and textures in files for viewers, for the program and the viewer alike
//     (packing_description.h), and `<name>.glsl`: the residual from the file's texels (apps/viewer/README.md).
//
// CMake finds the folder and generates the registry; command line, checkpoints, PLY columns, docs and the conformance
// tests follow from it.
#pragma once

#include "kernels/core/appearance_spec.h"
#include "kernels/core/vec.h"

namespace gs {

/// Largest distance at which a Gaussian counts as sitting on the camera centre: the direction is then undefined and
/// its gradient would be bounded by nothing (docs/math/appearance.md#view-direction).
inline constexpr double kMinViewDistance = 1e-6;

template <class T> struct ViewDirection {
    Vec3<T> unit;
    T inverse_distance; ///< 1/|mean - camera|; 0 when the direction is undefined, which zeroes the pullback
};

template <class T> GS_HD ViewDirection<T> view_direction(const Vec3<T>& mean, const Vec3<T>& camera_position) {
    const Vec3<T> v = mean - camera_position;
    const T distance = gs_sqrt(dot(v, v));
    if (!(distance >= T(kMinViewDistance))) return {{T(0), T(0), T(1)}, T(0)};
    const T inverse = T(1) / distance;
    return {v * inverse, inverse};
}

/// dL/dmean from dL/ddirection: (I - d d^T) g / |v|.
template <class T> GS_HD Vec3<T> direction_pullback(const ViewDirection<T>& d, const Vec3<T>& dL_ddirection) {
    return (dL_ddirection - d.unit * dot(d.unit, dL_ddirection)) * d.inverse_distance;
}

/// The optimizer keeps shared weights within this. Far above any that training finds; products over a few layers stay finite.
inline constexpr double kLargestSharedWeight = 1e4;

/// How many weights the Gaussians of a model share.
template <class Model> inline constexpr int kNumSharedOf = [] {
    if constexpr (requires { Model::kNumShared; })
        return Model::kNumShared;
    else
        return 0;
}();

/// The residual of any model: 0 below degree 1. `shared` and `params` may be null where the model has none.
template <class Model, class T> GS_HD Vec3<T> model_residual(const T* shared, const T* params, const Vec3<T>& direction, int degree) {
    if constexpr (Model::kDirectional) {
        if (degree > 0) {
            if constexpr (kNumSharedOf<Model> > 0)
                return Model::residual(shared, params, direction, degree);
            else
                return Model::residual(params, direction, degree);
        }
    }
    return {T(0), T(0), T(0)};
}

/// Its way back. `dL_dparams` is zeroed by the caller, `dL_dshared` is added to.
template <class Model, class T>
GS_HD void model_residual_backward(const T* shared, const T* params, const Vec3<T>& direction, int degree, const Vec3<T>& dL_dresidual, T* dL_dparams,
                                   Vec3<T>& dL_ddirection, T* dL_dshared) {
    dL_ddirection = {T(0), T(0), T(0)};
    if constexpr (Model::kDirectional) {
        if (degree <= 0) return;
        if constexpr (kNumSharedOf<Model> > 0)
            Model::residual_backward(shared, params, direction, degree, dL_dresidual, dL_dparams, dL_ddirection, dL_dshared);
        else
            Model::residual_backward(params, direction, degree, dL_dresidual, dL_dparams, dL_ddirection);
    }
}

/// Brightest colour: with it the faintest visible fragment (alpha 1/255) shows white. The loss squares colours twice, so that one
/// Gaussian of 1e10 would make it infinite, and with it every step of that view; and what a colour of 1e4 leaves in Adam's
/// second moments slows all Gaussians in front of it for thousands of steps.
inline constexpr double kLargestColor = 255;

/// phi(y): pre-activation colour to colour, at most kLargestColor (docs/math/appearance.md#colour-activation). NaN
/// stays NaN.
template <class T> GS_HD T color_activation(ColorActivation kind, T y) {
    switch (kind) {
        case ColorActivation::kRelu: return y + T(0.5) < T(0) ? T(0) : gs_min(T(kLargestColor), y + T(0.5));
        case ColorActivation::kSoftplus: {
            const T u = y + T(0.5); // divided by 10 term by term: 10 u may overflow, which only the exponential may see
            return gs_min(T(kLargestColor), gs_max(u, T(0)) + gs_log1p(gs_exp(T(-10) * gs_abs(u))) / T(10));
        }
        case ColorActivation::kSigmoid: return sigmoid(T(4) * y);
        case ColorActivation::kHardSigmoid: {
            const T u = y + T(0.5);
            return u < T(0) ? T(0) : (u > T(1) ? T(1) : u);
        }
    }
    return y;
}

/// phi'(y), computed from y: from the stored colour it would cancel near saturation
/// (docs/math/appearance.md#colour-activation). Above kLargestColor as if there were no limit, so that a colour comes
/// back from there.
template <class T> GS_HD T color_activation_derivative(ColorActivation kind, T y) {
    switch (kind) {
        case ColorActivation::kRelu: return y > T(-0.5) ? T(1) : T(0);
        case ColorActivation::kSoftplus: return sigmoid(T(10) * (y + T(0.5)));
        case ColorActivation::kSigmoid: return T(4) * sigmoid(T(4) * y) * sigmoid(T(-4) * y);
        case ColorActivation::kHardSigmoid: return y > T(-0.5) && y < T(0.5) ? T(1) : T(0);
    }
    return T(1);
}

/// phi^-1: base colour that shows `color`. The colour is first kept half an 8-bit step away from 0 and 1, where
/// every activation but softplus would start with a dead gradient (docs/math/appearance.md#initial-colour).
template <class T> GS_HD T inverse_color_activation(ColorActivation kind, T color) {
    const T c = gs_clamp(color, T(0.5 / 255), T(1 - 0.5 / 255));
    switch (kind) {
        case ColorActivation::kRelu:
        case ColorActivation::kHardSigmoid: return c - T(0.5);
        case ColorActivation::kSoftplus: return gs_log(gs_expm1(T(10) * c)) / T(10) - T(0.5);
        case ColorActivation::kSigmoid: return gs_log(c / (T(1) - c)) / T(4);
    }
    return c;
}

}  // namespace gs
