// SPDX-License-Identifier: Apache-2.0
// Spherical harmonics: golden values, orthonormality, parity.
#include <gtest/gtest.h>

#include "appearance/sh/sh.h"

namespace gs {
namespace {

using appearance::Sh;

const Vec3<double> kDirection{0.2672612419124244, 0.5345224838248488, 0.8017837257372732};  // (1,2,3) normalised

TEST(Sh, GoldenBasis) {
    const double want[15] = {-.26116903, .39175354,  -.13058451, .15607835,  -.46823504,
                             .29286360,  -.23411752, -.11705876, .02252797,  .33109217,
                             -.54095278, .06411572,  -.27047639, -.24831913, .12390383};
    double y[15];
    Sh::basis(kDirection, 3, y);
    for (int i = 0; i < 15; ++i) EXPECT_NEAR(y[i], want[i], 1e-8) << i + 1;
}

TEST(Sh, GoldenResidualAndMeanGradient) {
    double k[45], dk[45] = {};
    for (int i = 1; i <= 15; ++i)
        for (int c = 0; c < 3; ++c) k[3 * (i - 1) + c] = 0.1 * std::sin(i + c);
    const Vec3<double> r = Sh::residual(k, kDirection, 3);
    EXPECT_NEAR(r.x, .0154100871, 1e-9);
    EXPECT_NEAR(r.y, -.0680897117, 1e-9);
    EXPECT_NEAR(r.z, -.0889881436, 1e-9);
    Vec3<double> dd;
    Sh::residual_backward(k, kDirection, 3, {1, -.5, .25}, dk, dd);
    const Vec3<double> g = direction_pullback(view_direction(Vec3<double>{1, 2, 3}, Vec3<double>{0, 0, 0}), dd);
    EXPECT_NEAR(g.x, -.00716387148, 1e-10);
    EXPECT_NEAR(g.y, .00677030262, 1e-10);
    EXPECT_NEAR(g.z, -.00212557792, 1e-10);
}

TEST(Sh, IsOrthonormalOnTheSphere) {
    // Integrates by Gauss-Legendre in z (8 nodes: exact to degree 15) and by the trapezoid rule in the azimuth (exact
    // above degree 6).
    const double x[4] = {.1834346424956498, .5255324099163290, .7966664774136267, .9602898564975363};
    const double w[4] = {.3626837833783620, .3137066458778873, .2223810344533745, .1012285362903763};
    double gram[15][15] = {};
    for (int k = 0; k < 8; ++k)
        for (int j = 0; j < 16; ++j) {
            const double z = (k % 2 ? -1 : 1) * x[k / 2], r = std::sqrt(1 - z * z), a = 2 * M_PI * j / 16;
            double y[15];
            Sh::basis(Vec3<double>{r * std::cos(a), r * std::sin(a), z}, 3, y);
            for (int m = 0; m < 15; ++m)
                for (int n = 0; n < 15; ++n) gram[m][n] += w[k / 2] * 2 * M_PI / 16 * y[m] * y[n];
        }
    for (int m = 0; m < 15; ++m)
        for (int n = 0; n < 15; ++n) EXPECT_NEAR(gram[m][n], m == n, 1e-12) << m << "," << n;
}

TEST(Sh, OddBandsChangeSignAtTheAntipode) {
    double a[15], b[15];
    Sh::basis(kDirection, 3, a);
    Sh::basis(kDirection * -1.0, 3, b);
    for (int i = 0; i < 15; ++i) EXPECT_NEAR(b[i], (i >= 3 && i < 8 ? 1 : -1) * a[i], 1e-15);
}

}  // namespace
}  // namespace gs
