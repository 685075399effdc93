// SPDX-License-Identifier: Apache-2.0
// SH: real spherical harmonics of bands 1 to 3 (3DGS sign convention).
#pragma once

#include "appearance/contract.h"
#include "appearance/sh_basis.h"

namespace gs::appearance {

/// residual(d) = sum_i Y_i(d) k_i over the active bands; k_i are rows of 3 (rgb), i = 1..15 in the order of 3DGS.
struct Sh : ShBasis {
    static constexpr int kMaxResidual = 45;
    static constexpr bool kDirectional = true;

    template <class T> static GS_HD Vec3<T> residual(const T* params, const Vec3<T>& direction, int degree) {
        T y[15] = {};
        basis(direction, degree, y);
        Vec3<T> sum{T(0), T(0), T(0)};
        const int n = num_bases(degree);
        GS_UNROLL
        for (int i = 0; i < 15; ++i) {
            if (i >= n) break;
            sum += Vec3<T>{params[3 * i], params[3 * i + 1], params[3 * i + 2]} * y[i];
        }
        return sum;
    }

    template <class T>
    static GS_HD void residual_backward(const T* params, const Vec3<T>& direction, int degree,
                                        const Vec3<T>& dL_dresidual, T* dL_dparams, Vec3<T>& dL_ddirection) {
        T y[15] = {}, a[15] = {};
        basis(direction, degree, y);
        const int n = num_bases(degree);
        GS_UNROLL
        for (int i = 0; i < 15; ++i) {
            if (i >= n) break;
            const T* k = params + 3 * i;
            a[i] = k[0] * dL_dresidual.x + k[1] * dL_dresidual.y + k[2] * dL_dresidual.z;
            dL_dparams[3 * i] = y[i] * dL_dresidual.x;
            dL_dparams[3 * i + 1] = y[i] * dL_dresidual.y;
            dL_dparams[3 * i + 2] = y[i] * dL_dresidual.z;
        }
        dL_ddirection = basis_gradient(direction, degree, a);
    }
};

}  // namespace gs::appearance
