// SPDX-License-Identifier: Apache-2.0
// The constants of the rasterizer (docs/math/rasterizer.md#constants), each with the reason for its value.
#pragma once

namespace gs {

/// Square pixels added to both diagonal entries of the 2-D covariance: the reconstruction filter of 3DGS.
inline constexpr double kDilation = 0.3;
/// The same for an antialiased model: slightly above 1/12, the variance of a pixel's box (Mip-Splatting).
inline constexpr double kAntialiasedDilation = 0.1;
/// Variance of the 3-D filter on screen where a training view shows a Gaussian at its sharpest, in square pixels
/// (Mip-Splatting). With the dilation above it adds up to kDilation.
inline constexpr double kSmoothingVariance = 0.2;
/// Smallest determinant of a dilated covariance. Dilation makes it >= 0.09, so only cancellation gives a smaller value.
inline constexpr double kMinDeterminant = 1e-6;
/// Largest 2-D variance, in square pixels. A larger Gaussian is uniform over any image and its conic underflows.
inline constexpr double kMaxVariance2d = 1e12;
/// Largest log scale that is evaluated, so that exp(2 s) stays finite in float.
inline constexpr double kMaxLogScale = 40;
/// Smallest visible alpha, one 8-bit step. Fainter fragments and Gaussians are invisible.
inline constexpr double kMinAlpha = 1.0 / 255.0;
/// Transmittance below which a pixel is finished. The fragment that crosses this limit is still blended.
inline constexpr double kMinTransmittance = 1e-4;

/// Limits at which a backend stops: the two above, or higher limits that trade accuracy for speed.
template <class Real> struct Cutoffs {
    Real alpha = Real(kMinAlpha), inverse_alpha = Real(255);  ///< alpha is at least kMinAlpha
    Real transmittance = Real(kMinTransmittance);

    static Cutoffs of(double alpha, double transmittance) {
        return {Real(alpha), Real(1 / alpha), Real(transmittance)};
    }
};

/// Lower bound of 1-alpha in the backward pass.
inline constexpr double kMinOneMinusAlpha = 1e-6;
/// Smallest |q|^2. A shorter quaternion has no direction: its Gaussian is culled, and dead for densification.
inline constexpr double kMinQuaternionNorm2 = 1e-8;
/// Largest |q|^2. No optimizer step can rotate a longer quaternion noticeably, and float's range ends at 1e38.
inline constexpr double kMaxQuaternionNorm2 = 1e16;
/// Largest raw opacity. The transmittance there, 4.5e-5, is below kMinTransmittance, so a larger value would change no
/// image. From 17 on opacity is 1 in float, its slope is 0, and the Gaussian would stay opaque for ever.
inline constexpr double kMaxRawOpacity = 10;
/// Margin around the image, as a fraction of its size, up to which the projection's Jacobian is evaluated (3DGS: 1.3
/// tan(fov/2)).
inline constexpr double kFrustumMargin = 0.15;
/// Largest extents of a splat through a lens whose outline on screen is an ellipse: as the sine of an angle, and drawn
/// as by pinholes in distances of its face from the camera. A larger splat may reach all pixels.
inline constexpr double kMostLensExtent = 0.95, kMostFaceExtent = 2;
inline constexpr double kLog2E = 1.4426950408889634;

/// A tile of the CPU has 16x16 pixels, which are 16 blocks of 4x4, so that one lane operation tests all blocks of a
/// tile.
inline constexpr int kCpuTile = 16;
/// Width of a tile on all devices: bounds beyond the seam of a 360-degree image are whole tiles.
inline constexpr int kTileWidth = 16;
inline constexpr int kCpuBlock = 4;

}  // namespace gs
