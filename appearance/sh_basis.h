// SPDX-License-Identifier: Apache-2.0
// The basis of real spherical harmonics of bands 1 to 3 (3DGS sign convention).
#pragma once

#include "kernels/base/vec.h"

namespace gs::appearance {

struct ShBasis {
    // Normalisation constants sqrt((2l+1)/(4 pi) (l-m)!/(l+m)!) times the polynomial's factor. Names are as in
    // sh/README.md.
    static constexpr double kC1 = 0.4886025119029199;
    static constexpr double k2a = 1.0925484305920792, k2b = 0.9461746957575601, k2c = 0.31539156525252005,
                            k2d = 0.5462742152960396;
    static constexpr double k3a = 0.5900435899266435, k3c = 2.890611442640554, k3d = 0.4570457994644658;
    static constexpr double k3f = 0.3731763325901154, k3h = 1.445305721320277;

    /// Returns the number of basis functions above band 0 that are active at `degree`.
    static GS_HD int num_bases(int degree) { return (degree + 1) * (degree + 1) - 1; }

    /// Writes the active Y_i, i = 1.., into y[0..num_bases-1].
    template <class T> static GS_HD void basis(const Vec3<T>& d, int degree, T* y) {
        const T x = d.x, yy = d.y, z = d.z;
        if (degree >= 1) {
            y[0] = T(-kC1) * yy;
            y[1] = T(kC1) * z;
            y[2] = T(-kC1) * x;
        }
        if (degree >= 2) {
            y[3] = T(k2a) * x * yy;
            y[4] = T(-k2a) * yy * z;
            y[5] = T(k2b) * z * z - T(k2c);
            y[6] = T(-k2a) * x * z;
            y[7] = T(k2d) * (x * x - yy * yy);
        }
        if (degree >= 3) {
            y[8] = T(k3a) * yy * (yy * yy - T(3) * x * x);
            y[9] = T(k3c) * x * yy * z;
            y[10] = T(k3d) * yy * (T(1) - T(5) * z * z);
            y[11] = T(k3f) * z * (T(5) * z * z - T(3));
            y[12] = T(k3d) * x * (T(1) - T(5) * z * z);
            y[13] = T(k3h) * z * (x * x - yy * yy);
            y[14] = T(k3a) * x * (T(3) * yy * yy - x * x);
        }
    }

    /// Returns sum_i a_i grad Y_i(d), which is dL_ddirection for a_i = k_i . dL_dresidual.
    template <class T> static GS_HD Vec3<T> basis_gradient(const Vec3<T>& d, int degree, const T* a) {
        const T x = d.x, y = d.y, z = d.z;
        Vec3<T> g{T(0), T(0), T(0)};
        if (degree >= 1) g += Vec3<T>{T(-kC1) * a[2], T(-kC1) * a[0], T(kC1) * a[1]};
        if (degree >= 2) {
            const T c = T(k2a);
            g += Vec3<T>{c * (y * a[3] - z * a[6] + x * a[7]), c * (x * a[3] - z * a[4] - y * a[7]),
                         c * (-y * a[4] - x * a[6]) + T(2 * k2b) * z * a[5]};
        }
        if (degree >= 3) {
            const T c3 = T(3 * k3a), q = T(k3d) * (T(1) - T(5) * z * z), p = T(3 * k3a) * (y * y - x * x),
                    s = T(k3h) * (x * x - y * y);
            g += Vec3<T>{
                T(-2) * c3 * x * y * a[8] + T(k3c) * y * z * a[9] + q * a[12] + T(2 * k3h) * x * z * a[13] + p * a[14],
                p * a[8] + T(k3c) * x * z * a[9] + q * a[10] - T(2 * k3h) * y * z * a[13] + T(2) * c3 * x * y * a[14],
                T(k3c) * x * y * a[9] - T(10 * k3d) * z * (y * a[10] + x * a[12]) +
                    T(3 * k3f) * (T(5) * z * z - T(1)) * a[11] + s * a[13]};
        }
        return g;
    }
};

}  // namespace gs::appearance
