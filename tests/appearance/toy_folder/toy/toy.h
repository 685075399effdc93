// SPDX-License-Identifier: Apache-2.0
// Toy: a colour that is linear in the direction.
#pragma once

#include "appearance/contract.h"

namespace gs::appearance {

/// residual(d) = M d; params: the 3x3 matrix M by rows, one row a colour channel.
struct Toy {
    static constexpr int kMaxResidual = 9;
    static constexpr bool kDirectional = true;

    template <class T> static GS_HD Vec3<T> residual(const T* m, const Vec3<T>& d, int degree) {
        if (degree <= 0) return {T(0), T(0), T(0)};
        return {m[0] * d.x + m[1] * d.y + m[2] * d.z, m[3] * d.x + m[4] * d.y + m[5] * d.z,
                m[6] * d.x + m[7] * d.y + m[8] * d.z};
    }

    template <class T>
    static GS_HD void residual_backward(const T* m, const Vec3<T>& d, int degree, const Vec3<T>& dL_dresidual, T* dL_dm,
                                        Vec3<T>& dL_ddirection) {
        dL_ddirection = {T(0), T(0), T(0)};
        if (degree <= 0) return;
        const T g[3] = {dL_dresidual.x, dL_dresidual.y, dL_dresidual.z};
        for (int c = 0; c < 3; ++c) {
            dL_dm[3 * c] = g[c] * d.x, dL_dm[3 * c + 1] = g[c] * d.y, dL_dm[3 * c + 2] = g[c] * d.z;
            dL_ddirection += Vec3<T>{m[3 * c], m[3 * c + 1], m[3 * c + 2]} * g[c];
        }
    }
};

}  // namespace gs::appearance
