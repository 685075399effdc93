// SPDX-License-Identifier: Apache-2.0
// Constants of the rasterizer (docs/math/rasterizer.md#constants) and why each has its value.
#pragma once

namespace gs {

/// Added to both diagonal entries of the 2-D covariance, square pixels: the reconstruction filter of 3DGS.
inline constexpr double kDilation = 0.3;
/// Dilated covariances below this determinant are culled; dilation makes it >= 0.09, so only cancellation gets here.
inline constexpr double kMinDeterminant = 1e-6;
/// 2-D variances above this are culled: such a Gaussian is uniform over any image and its conic underflows.
inline constexpr double kMaxVariance2d = 1e12;
/// Log scales are evaluated at most at this value, so that exp(2 s) stays finite in float.
inline constexpr double kMaxLogScale = 40;
/// Fragments and Gaussians fainter than one 8-bit step are invisible.
inline constexpr double kMinAlpha = 1.0 / 255.0;
/// A pixel is finished by the fragment that takes its transmittance below this; that fragment is still blended.
inline constexpr double kMinTransmittance = 1e-4;

/// Where a backend stops looking: the two limits above, or higher ones that trade accuracy for speed.
template <class Real> struct Cutoffs {
    Real alpha = Real(kMinAlpha), inverse_alpha = Real(255); ///< at least kMinAlpha, below which nothing is kept for rendering
    Real transmittance = Real(kMinTransmittance);

    static Cutoffs of(double alpha, double transmittance) { return {Real(alpha), Real(1 / alpha), Real(transmittance)}; }
};

/// Floor of 1-alpha in the backward pass.
inline constexpr double kMinOneMinusAlpha = 1e-6;
/// |q|^2 below this has no direction: culled, and dead for densification.
inline constexpr double kMinQuaternionNorm2 = 1e-8;
/// And above this: no step of the optimizer turns it any more, and 1e38 ends float's range.
inline constexpr double kMaxQuaternionNorm2 = 1e16;
/// Raw opacities stay at or below this. The transmittance there, 4.5e-5, is below kMinTransmittance, so more would change no
/// image; but from 17 on opacity is 1 in float, its slope 0, and the Gaussian opaque for ever.
inline constexpr double kMaxRawOpacity = 10;
/// The Jacobian of the projection is evaluated at most this fraction of the image outside of it (3DGS: 1.3 tan(fov/2)).
inline constexpr double kFrustumMargin = 0.15;
inline constexpr double kLog2E = 1.4426950408889634;

/// CPU tile: 16x16 pixels = 16 blocks of 4x4, so that one lane operation tests all blocks of a tile.
inline constexpr int kCpuTile = 16;
inline constexpr int kCpuBlock = 4;

}  // namespace gs
