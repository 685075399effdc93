// SPDX-License-Identifier: Apache-2.0
// The regularisers that keep PPISP from explaining what the scene should explain (docs/math/ppisp.md#regularizers).
//
// All terms are part of every step's loss and touch every frame and camera. First the mean of each value over all
// frames is taken. The gradient of each value then needs no other values.
#pragma once

#include "kernels/ppisp/ppisp_device.h"

namespace gs {

// Exposures and colours are known up to a common factor, which the Gaussians take up, so their means are held at 0. The
// pull is proportional below the bend and constant above it, so that it does not outweigh the images.
inline constexpr double kIspExposureMean = 1.0, kIspExposureBend = 0.1;
inline constexpr double kIspColorMean = 1.0, kIspColorBend = 0.005;
// A lens darkens towards the edge (alpha <= 0), around the middle of the image, for all colours alike. A camera's
// response is nearly the same for all colours.
inline constexpr double kIspVignetteCentre = 0.02, kIspVignettePositive = 0.01, kIspVignetteVariance = 0.1,
                        kIspResponseVariance = 0.1;

/// Returns the slope of smooth L1, which is x^2 / (2 bend) near 0 and |x| - bend/2 beyond.
template <class Real> GS_HD Real smooth_l1_slope(Real x, Real bend) { return gs_clamp(x / bend, Real(-1), Real(1)); }

/// Computes the gradient of the terms on frames, which is the same for each frame, from the means of the raw values
/// over all frames. Both have kIspFrameValues values.
template <class Real> GS_HD void isp_frame_regularizer(const Real* means, int num_frames, Real* gradient) {
    gradient[0] = Real(kIspExposureMean) * smooth_l1_slope(means[0], Real(kIspExposureBend)) / Real(num_frames);
    const Real weight = Real(kIspColorMean) / (Real(8) * Real(num_frames));
    for (int k = 0; k < 4; ++k) {
        const Sym2<double> scale = isp_latent_scale(k);
        const Vec2<double> offset = isp_times(scale, double(means[1 + 2 * k]), double(means[2 + 2 * k]));
        const Vec2<double> g =
            isp_times(scale, smooth_l1_slope(offset.x, kIspColorBend), smooth_l1_slope(offset.y, kIspColorBend));
        gradient[1 + 2 * k] = weight * Real(g.x), gradient[2 + 2 * k] = weight * Real(g.y);
    }
}

/// Returns the gradient of the terms on cameras for value `k` of one camera, whose raw values are `raw`
/// (kIspCameraValues).
template <class Real> GS_HD Real isp_camera_regularizer(const Real* raw, int num_cameras, int k) {
    const bool vignetting = k < 3 * kIspVignetting;
    const int first = vignetting ? 0 : 3 * kIspVignetting, width = vignetting ? kIspVignetting : kIspResponse,
              column = (k - first) % width;
    // The term is the variance over the channels, averaged over cameras and columns.
    const Real* channel = raw + first + column;
    const Real mean = (channel[0] + channel[width] + channel[2 * width]) / Real(3), cameras = Real(num_cameras);
    Real g = Real(vignetting ? kIspVignetteVariance : kIspResponseVariance) * Real(2) * (raw[k] - mean) /
             (Real(3 * width) * cameras);
    if (vignetting && column < 2) g += Real(kIspVignetteCentre) * Real(2) * raw[k] / (Real(3) * cameras);
    if (vignetting && column >= 2 && raw[k] > Real(0)) g += Real(kIspVignettePositive) / (Real(9) * cameras);
    return g;
}

}  // namespace gs
