// SPDX-License-Identifier: Apache-2.0
// None: the same colour in every direction.
#pragma once

#include "appearance/contract.h"

namespace gs::appearance {

/// residual(d) = 0, without parameters.
struct None {
    static constexpr int kMaxResidual = 0;
    static constexpr bool kDirectional = false;
    template <class T> static GS_HD Vec3<T> residual(const T*, const Vec3<T>&, int) { return {T(0), T(0), T(0)}; }
    template <class T>
    static GS_HD void residual_backward(const T*, const Vec3<T>&, int, const Vec3<T>&, T*, Vec3<T>& dL_ddirection) {
        dL_ddirection = {T(0), T(0), T(0)};
    }
};

}  // namespace gs::appearance
