// SPDX-License-Identifier: Apache-2.0
// PPISP for one pixel, forward (docs/math/ppisp.md#pipeline) and backward (docs/math/ppisp.md#gradients): exposure,
// vignetting, colour homography, response.
//
// Values common to all pixels of a view are prepared once (isp_frame, isp_camera). The backward pass adds 37 numbers
// per pixel, the gradients of the prepared values. isp_finish converts their sums over the view to gradients of the
// parameters.
#pragma once

#include "kernels/base/vec.h"
#include "kernels/state/ppisp_state.h"

namespace gs {

/// Limit to which exposures are clamped, in stops. 2^16 times the brightest colour is still far inside float's range.
inline constexpr double kLargestExposure = 16;
/// Smallest divisor of the corrected intensity. (The reference adds it instead, which darkens every pixel a little; a
/// neutral correction would then change pixels.)
inline constexpr double kIspIntensityEpsilon = 1e-5;
/// Smallest divisor of the homography, as a fraction of its largest element; above it the divisor is the last element.
/// A correction below it is far from any plausible colour, and only has to stay finite. (The factor nearly cancels,
/// because colours keep their intensity.)
inline constexpr double kIspSmallestScale = 1e-6;
/// Limit to which slopes of the response are clamped. With exponents of 0.3 and 0.1 the slope at black is unbounded.
inline constexpr double kIspLargestSlope = 1e12;

/// The prepared exposure and colour of one frame.
template <class Real> struct IspFrame {
    Real gain;       ///< 2^exposure
    Mat3<Real> mix;  ///< homography of (red, green, intensity), as it acts on (red, green, blue)
};

/// The response of one channel from 0 to 1. Toe and shoulder meet at the centre with the same value and slope.
template <class Real> struct IspResponse {
    Real toe, shoulder, gamma;  ///< exponents
    Real centre, rest;          ///< centre, and 1 - centre without its rounding error
    Real inverse_length;        ///< 1 / (shoulder centre + toe rest)
};

/// The prepared vignetting and response of one camera.
template <class Real> struct IspCamera {
    Real vignetting[3][kIspVignetting];  ///< cx, cy, alpha0..2 of each channel
    IspResponse<Real> response[3];
};

/// First index of each part of the sums.
inline constexpr int kIspSumExposure = 0, kIspSumMix = 1, kIspSumVignetting = kIspSumMix + 9,
                     kIspSumResponse = kIspSumVignetting + 3 * kIspVignetting,
                     kIspSums = kIspSumResponse + 3 * kIspResponse;
static_assert(kIspSums == 37);

/// The gradients of the values common to a view's pixels: exposure (in stops); mix, row-major; vignetting per channel;
/// toe, shoulder, gamma (activated) and centre per channel.
template <class Real> struct IspSums { Real v[kIspSums]; };

// --- the homography, once per view, in double ------------------------------------------------------------------------

/// The homography of a frame's colour latents, with the intermediate results of its gradient.
struct IspColor {
    Vec3<double> target[4];  ///< targets of blue, red, green and neutral
    Vec3<double> rows[3];    ///< rows of M = [neutral]x (blue red green), which has rank 2
    int first, second;       ///< rows whose cross product is lambda
    Vec3<double> lambda;     ///< M's null vector: weights that mix neutral from blue, red and green
    Mat3<double> mixed;      ///< homography before the division by `scale`
    double scale;            ///< divisor of the homography
    bool scaled_by_element;  ///< whether scale is the last element (and not the lower bound)
};

/// Returns the symmetric matrix (xx, xy, yy) that maps the latents of a point to the offset of its target. It gives a
/// unit of every latent about the same effect.
GS_HD Sym2<double> isp_latent_scale(int point) {
    switch (point) {
        case 0:
            return {0.0480542, -0.0043631, 0.0481283};
        case 1:
            return {0.0580570, -0.0179872, 0.0431061};
        case 2:
            return {0.0433336, -0.0180537, 0.0580500};
        default:
            return {0.0128369, -0.0034654, 0.0128158};
    }
}
GS_HD Vec2<double> isp_times(const Sym2<double>& m, double x, double y) {
    return {m.xx * x + m.xy * y, m.xy * x + m.yy * y};
}

/// Computes the homography from the latents (blue, red, green, neutral) x 2.
template <class Real> GS_HD IspColor isp_color(const Real* latents) {
    const double third = 1.0 / 3.0, source[4][2] = {{0, 0}, {1, 0}, {0, 1}, {third, third}};
    IspColor c;
    for (int k = 0; k < 4; ++k) {
        const Vec2<double> offset = isp_times(isp_latent_scale(k), double(latents[2 * k]), double(latents[2 * k + 1]));
        c.target[k] = {source[k][0] + offset.x, source[k][1] + offset.y, 1};
    }
    const Vec3<double> b = cross(c.target[3], c.target[0]), r = cross(c.target[3], c.target[1]),
                       g = cross(c.target[3], c.target[2]);
    c.rows[0] = {b.x, r.x, g.x}, c.rows[1] = {b.y, r.y, g.y}, c.rows[2] = {b.z, r.z, g.z};
    // All pairs give the same vector up to a factor, which the scale cancels. The longest has the smallest rounding
    // error.
    double longest = -1;
    for (int i = 0; i < 2; ++i) {
        for (int j = i + 1; j < 3; ++j) {
            const Vec3<double> candidate = cross(c.rows[i], c.rows[j]);
            const double length = dot(candidate, candidate);
            if (length > longest) longest = length, c.lambda = candidate, c.first = i, c.second = j;
        }
    }
    const Vec3<double> mb = c.target[0] * c.lambda.x, mr = c.target[1] * c.lambda.y, mg = c.target[2] * c.lambda.z;
    // The columns (red - blue, green - blue, blue) apply the inverse of the sources' matrix.
    c.mixed = {{mr.x - mb.x, mg.x - mb.x, mb.x}, {mr.y - mb.y, mg.y - mb.y, mb.y}, {mr.z - mb.z, mg.z - mb.z, mb.z}};
    const auto largest_of = [](const Vec3<double>& v) { return gs_max(gs_abs(v.x), gs_max(gs_abs(v.y), gs_abs(v.z))); };
    const double largest = gs_max(largest_of(c.mixed.r0), gs_max(largest_of(c.mixed.r1), largest_of(c.mixed.r2)));
    const double element = c.mixed.r2.z, bound = gs_max(kIspSmallestScale * largest, 1e-30);
    c.scaled_by_element = gs_abs(element) >= bound;
    c.scale = c.scaled_by_element ? element : (element < 0 ? -bound : bound);
    return c;
}

/// Computes dL/dlatents (8) from dL/dhomography (9, row-major).
template <class Real> GS_HD void isp_color_backward(const IspColor& c, const Real* dL_dhomography, Real* dL_dlatents) {
    double g[9], inner = 0;
    const Vec3<double>* const u[3] = {&c.mixed.r0, &c.mixed.r1, &c.mixed.r2};
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) g[3 * i + j] = double(dL_dhomography[3 * i + j]) / c.scale;
        inner += g[3 * i] * u[i]->x + g[3 * i + 1] * u[i]->y + g[3 * i + 2] * u[i]->z;
    }
    if (c.scaled_by_element) g[8] -= inner / c.scale;
    // Columns of dL/d(targets times lambda).
    const Vec3<double> red{g[0], g[3], g[6]}, green{g[1], g[4], g[7]}, last{g[2], g[5], g[8]},
        mixed[3] = {last - red - green, red, green};
    const Vec3<double> dL_dlambda{dot(c.target[0], mixed[0]), dot(c.target[1], mixed[1]), dot(c.target[2], mixed[2])};
    Vec3<double> dL_drows[3] = {};
    dL_drows[c.first] = cross(c.rows[c.second], dL_dlambda);
    dL_drows[c.second] = cross(dL_dlambda, c.rows[c.first]);
    const Vec3<double> dL_dcolumns[3] = {{dL_drows[0].x, dL_drows[1].x, dL_drows[2].x},
                                         {dL_drows[0].y, dL_drows[1].y, dL_drows[2].y},
                                         {dL_drows[0].z, dL_drows[1].z, dL_drows[2].z}};
    const double lambda[3] = {c.lambda.x, c.lambda.y, c.lambda.z};
    Vec3<double> dL_dtarget[4] = {};
    for (int k = 0; k < 3; ++k) {  // the columns are neutral x target
        dL_dtarget[k] = mixed[k] * lambda[k] + cross(dL_dcolumns[k], c.target[3]);
        dL_dtarget[3] += cross(c.target[k], dL_dcolumns[k]);
    }
    for (int k = 0; k < 4; ++k) {
        const Vec2<double> d = isp_times(isp_latent_scale(k), dL_dtarget[k].x, dL_dtarget[k].y);
        dL_dlatents[2 * k] = Real(d.x), dL_dlatents[2 * k + 1] = Real(d.y);
    }
}

// --- the prepared values of a view -----------------------------------------------------------------------------------

/// Prepares a frame from kIspFrameValues raw values.
template <class Real> GS_HD IspFrame<Real> isp_frame(const Real* raw) {
    const IspColor color = isp_color(raw + 1);
    // Intensity is the sum of the channels, and blue is intensity minus red and green. In double, a neutral correction
    // is 1 to the bit.
    const auto on_channels = [&](const Vec3<double>& row) {
        return Vec3<double>{(row.x + row.z) / color.scale, (row.y + row.z) / color.scale, row.z / color.scale};
    };
    const Vec3<double> red = on_channels(color.mixed.r0), green = on_channels(color.mixed.r1),
                       blue = on_channels(color.mixed.r2) - red - green;
    const auto rounded = [](const Vec3<double>& v) { return Vec3<Real>{Real(v.x), Real(v.y), Real(v.z)}; };
    return {gs_exp2(gs_clamp(raw[0], Real(-kLargestExposure), Real(kLargestExposure))),
            {rounded(red), rounded(green), rounded(blue)}};
}

/// The smallest toe and shoulder, and the smallest gamma.
inline constexpr double kIspLeastToe = 0.3, kIspLeastGamma = 0.1;

/// Prepares a camera from kIspCameraValues raw values. Exponents are computed in double, so that a neutral correction
/// has exponents of 1 to the bit.
template <class Real> GS_HD IspCamera<Real> isp_camera(const Real* raw) {
    IspCamera<Real> camera;
    for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < kIspVignetting; ++k) camera.vignetting[c][k] = raw[c * kIspVignetting + k];
        const Real* response = raw + 3 * kIspVignetting + c * kIspResponse;
        IspResponse<Real>& r = camera.response[c];
        r.toe = Real(kIspLeastToe + softplus(double(response[0])));
        r.shoulder = Real(kIspLeastToe + softplus(double(response[1])));
        r.gamma = Real(kIspLeastGamma + softplus(double(response[2])));
        r.centre = sigmoid(response[3]);
        r.rest = sigmoid(-response[3]);
        r.inverse_length = Real(1) / (r.shoulder * r.centre + r.toe * r.rest);
    }
    return camera;
}

/// Returns the centre of pixel (x, y) in coordinates with origin at the image's centre and a longer side of 1.
template <class Real> GS_HD Vec2<Real> isp_uv(int x, int y, int width, int height) {
    const Real longer = Real(width > height ? width : height);
    return {(Real(x) + Real(0.5) - Real(0.5) * Real(width)) / longer,
            (Real(y) + Real(0.5) - Real(0.5) * Real(height)) / longer};
}

// --- one pixel -------------------------------------------------------------------------------------------------------

/// Returns the vignetting factor of one channel before it is clamped to [0,1].
template <class Real> GS_HD Real isp_vignette(const Real* v, const Vec2<Real>& uv) {
    const Real dx = uv.x - v[0], dy = uv.y - v[1], r2 = dx * dx + dy * dy;
    return Real(1) + r2 * (v[2] + r2 * (v[3] + r2 * v[4]));
}

/// Adds the gradients dL/d(cx, cy, alpha0..2) to `sums`, given dL/dfactor.
template <class Real>
GS_HD void isp_vignette_backward(const Real* v, const Vec2<Real>& uv, Real dL_dfactor, Real* sums) {
    const Real dx = uv.x - v[0], dy = uv.y - v[1], r2 = dx * dx + dy * dy;
    const Real dL_dr2 = dL_dfactor * (v[2] + r2 * (Real(2) * v[3] + Real(3) * r2 * v[4]));
    sums[0] -= Real(2) * dL_dr2 * dx;
    sums[1] -= Real(2) * dL_dr2 * dy;
    sums[2] += dL_dfactor * r2;
    sums[3] += dL_dfactor * r2 * r2;
    sums[4] += dL_dfactor * r2 * r2 * r2;
}

/// Clamps to [0,1]. NaN stays NaN, so that it shows up in the loss.
template <class Real> GS_HD Real isp_unit(Real x) { return x < Real(0) ? Real(0) : (x > Real(1) ? Real(1) : x); }

/// Returns x^exponent for x >= 0. An exponent of 1 returns x to the bit.
template <class Real> GS_HD Real isp_power(Real x, Real exponent) {
    return exponent == Real(1) ? x : gs_pow(x, exponent);
}

/// Returns the response before gamma, in [0,1].
template <class Real> GS_HD Real isp_curve(const IspResponse<Real>& r, Real value) {
    const Real x = isp_unit(value);
    if (x <= r.centre)
        return x > Real(0) ? r.centre * r.shoulder * r.inverse_length * isp_power(x / r.centre, r.toe) : Real(0);
    return Real(1) - r.rest * r.toe * r.inverse_length * isp_power((Real(1) - x) / r.rest, r.shoulder);
}

template <class Real> GS_HD Real isp_respond(const IspResponse<Real>& r, Real value) {
    const Real y = isp_curve(r, value);
    return y <= Real(0) ? Real(0) : isp_power(y, r.gamma);
}

/// Returns dL/dvalue, and adds dL/d(toe, shoulder, gamma, centre) to `sums`. All are 0 for values outside (0,1).
template <class Real>
GS_HD Real isp_respond_backward(const IspResponse<Real>& r, Real value, Real dL_dout, Real* sums) {
    const Real x = isp_unit(value), y = isp_curve(r, value);
    if (!(y > Real(0))) return Real(0);
    // With l = 1/inverse_length: on the toe's side y = centre shoulder/l u^toe, u = x/centre; on the shoulder's side 1
    // - y = rest toe/l w^shoulder, w = (1-x)/rest. In this form the sums are not divided by a centre or rest that may
    // be 0.
    const Real above = r.shoulder * r.inverse_length, below = r.toe * r.inverse_length;
    const Real skew = (r.shoulder - r.toe) * r.inverse_length;
    const Real out = isp_power(y, r.gamma), dL_dy = dL_dout * gs_min(r.gamma * out / y, Real(kIspLargestSlope));
    sums[2] += dL_dout * out * gs_log(y);
    if (x <= r.centre) {
        const Real u = x / r.centre, p = isp_power(u, r.toe);
        sums[0] += dL_dy * y * (gs_log(u) - r.rest * r.inverse_length);
        sums[1] += dL_dy * r.centre * p * r.rest * below * r.inverse_length;
        sums[3] += dL_dy * above * p * (Real(1) - r.toe - skew * r.centre);
        return dL_dy * gs_min(above * r.toe * p / u, Real(kIspLargestSlope));
    }
    const Real w = (Real(1) - x) / r.rest;
    if (!(w > Real(0))) return Real(0);
    const Real p = isp_power(w, r.shoulder);
    sums[0] -= dL_dy * r.rest * p * r.centre * above * r.inverse_length;
    sums[1] -= dL_dy * r.rest * below * p * (gs_log(w) - r.centre * r.inverse_length);
    sums[3] += dL_dy * below * p * (Real(1) - r.shoulder + skew * r.rest);
    return dL_dy * gs_min(below * r.shoulder * p / w, Real(kIspLargestSlope));
}

/// Intermediate values of one pixel.
template <class Real> struct IspPixel {
    Vec3<Real> exposed;    ///< colour after exposure
    Vec3<Real> vignetted;  ///< colour after vignetting
    Vec3<Real> factor;     ///< vignetting before it is clamped to [0,1]
    Vec3<Real> mapped;     ///< mix times vignetted
    Real divisor, k;       ///< mapped is multiplied by k = intensity / divisor
    bool divides;          ///< whether the divisor is the intensity of mapped, and not the lower bound
    Vec3<Real> balanced;   ///< colour before the response
};

template <class Real>
GS_HD IspPixel<Real> isp_pixel(const IspFrame<Real>& frame, const IspCamera<Real>& camera, const Vec3<Real>& rgb,
                               const Vec2<Real>& uv) {
    const auto positive = [](Real x) { return x < Real(0) ? Real(0) : x; };
    IspPixel<Real> p;
    p.exposed = Vec3<Real>{positive(rgb.x), positive(rgb.y), positive(rgb.z)} * frame.gain;
    p.factor = {isp_vignette(camera.vignetting[0], uv), isp_vignette(camera.vignetting[1], uv),
                isp_vignette(camera.vignetting[2], uv)};
    p.vignetted = p.exposed * Vec3<Real>{gs_clamp(p.factor.x, Real(0), Real(1)), gs_clamp(p.factor.y, Real(0), Real(1)),
                                         gs_clamp(p.factor.z, Real(0), Real(1))};
    const auto intensity = [](const Vec3<Real>& v) { return v.x + v.y + v.z; };
    p.mapped = frame.mix * p.vignetted;
    const Real mapped = intensity(p.mapped);
    p.divides = mapped > Real(kIspIntensityEpsilon);
    p.divisor = p.divides ? mapped : Real(kIspIntensityEpsilon);
    p.k = intensity(p.vignetted) / p.divisor;
    p.balanced = p.mapped * p.k;
    return p;
}

/// Returns the corrected colour, in [0,1]. `rgb` is linear and unbounded above; values below 0 count as 0. `uv` is the
/// result of isp_uv.
template <class Real>
GS_HD Vec3<Real> isp_forward(const IspFrame<Real>& frame, const IspCamera<Real>& camera, const Vec3<Real>& rgb,
                             const Vec2<Real>& uv) {
    const Vec3<Real> x = isp_pixel(frame, camera, rgb, uv).balanced;
    return {isp_respond(camera.response[0], x.x), isp_respond(camera.response[1], x.y),
            isp_respond(camera.response[2], x.z)};
}

/// Returns dL/drgb, and adds the pixel's contribution to `sums`.
template <class Real>
GS_HD Vec3<Real> isp_backward(const IspFrame<Real>& frame, const IspCamera<Real>& camera, const Vec3<Real>& rgb,
                              const Vec2<Real>& uv, const Vec3<Real>& dL_dout, IspSums<Real>& sums) {
    const IspPixel<Real> p = isp_pixel(frame, camera, rgb, uv);
    Real* const response = sums.v + kIspSumResponse;
    const Vec3<Real> g{isp_respond_backward(camera.response[0], p.balanced.x, dL_dout.x, response),
                       isp_respond_backward(camera.response[1], p.balanced.y, dL_dout.y, response + kIspResponse),
                       isp_respond_backward(camera.response[2], p.balanced.z, dL_dout.z, response + 2 * kIspResponse)};
    const Real dL_dk = dot(g, p.mapped), dL_dmapped_intensity = p.divides ? -dL_dk * p.k / p.divisor : Real(0),
               dL_dintensity = dL_dk / p.divisor;
    const Vec3<Real> dL_dmapped =
        g * p.k + Vec3<Real>{dL_dmapped_intensity, dL_dmapped_intensity, dL_dmapped_intensity};
    Real* const mix = sums.v + kIspSumMix;
    const Real rows[3] = {dL_dmapped.x, dL_dmapped.y, dL_dmapped.z};
    GS_UNROLL
    for (int i = 0; i < 3; ++i) {
        mix[3 * i] += rows[i] * p.vignetted.x;
        mix[3 * i + 1] += rows[i] * p.vignetted.y;
        mix[3 * i + 2] += rows[i] * p.vignetted.z;
    }
    const Vec3<Real> dL_dvignetted =
        frame.mix.transposed_times(dL_dmapped) + Vec3<Real>{dL_dintensity, dL_dintensity, dL_dintensity};
    // The bounds of the vignetting factor count as inside: without vignetting the factor is 1 everywhere, and must be
    // able to change.
    Real* const vignetting = sums.v + kIspSumVignetting;
    const auto vignette = [&](int c, Real factor, Real exposed, Real dL_dv) {
        if (factor >= Real(0) && factor <= Real(1))
            isp_vignette_backward(camera.vignetting[c], uv, dL_dv * exposed, vignetting + c * kIspVignetting);
        return dL_dv * gs_clamp(factor, Real(0), Real(1));
    };
    const Vec3<Real> dL_dexposed{vignette(0, p.factor.x, p.exposed.x, dL_dvignetted.x),
                                 vignette(1, p.factor.y, p.exposed.y, dL_dvignetted.y),
                                 vignette(2, p.factor.z, p.exposed.z, dL_dvignetted.z)};
    sums.v[kIspSumExposure] += Real(0.6931471805599453) * dot(dL_dexposed, p.exposed);
    const auto through = [&](Real x, Real d) { return x < Real(0) ? Real(0) : frame.gain * d; };
    return {through(rgb.x, dL_dexposed.x), through(rgb.y, dL_dexposed.y), through(rgb.z, dL_dexposed.z)};
}

/// Computes the gradients of the raw values of a frame (kIspFrameValues) and of a camera (kIspCameraValues) from the
/// sums over a view.
template <class Real>
GS_HD void isp_finish(const Real* raw_frame, const Real* raw_camera, const IspSums<Real>& sums, Real* dL_dframe,
                      Real* dL_dcamera) {
    dL_dframe[0] = gs_abs(raw_frame[0]) <= Real(kLargestExposure) ? sums.v[kIspSumExposure] : Real(0);
    // Mix is S H S^-1, where S maps (red, green, intensity) to (red, green, blue). The gradient of H is S^T dL/dmix
    // S^-T.
    const Real* g = sums.v + kIspSumMix;
    Real dL_dhomography[9];
    for (int j = 0; j < 3; ++j)
        dL_dhomography[j] = g[j] - g[6 + j], dL_dhomography[3 + j] = g[3 + j] - g[6 + j],
        dL_dhomography[6 + j] = g[6 + j];
    for (int i = 0; i < 3; ++i) dL_dhomography[3 * i + 2] += dL_dhomography[3 * i] + dL_dhomography[3 * i + 1];
    isp_color_backward(isp_color(raw_frame + 1), dL_dhomography, dL_dframe + 1);
    for (int k = 0; k < 3 * kIspVignetting; ++k) dL_dcamera[k] = sums.v[kIspSumVignetting + k];
    for (int k = 0; k < 3 * kIspResponse; ++k) {
        const Real slope = sigmoid(raw_camera[3 * kIspVignetting + k]);  // slope of softplus
        const bool centre = k % kIspResponse == 3;
        dL_dcamera[3 * kIspVignetting + k] =
            sums.v[kIspSumResponse + k] * (centre ? slope * sigmoid(-raw_camera[3 * kIspVignetting + k]) : slope);
    }
}

// The regularisers that keep PPISP from modelling effects that belong to the scene (docs/math/ppisp.md#regularizers).
//
// All terms are part of every step's loss and affect every frame and camera. First the mean of each value over all
// frames is computed. Then the gradient of each value needs no other values.

// Exposures and colours are only determined up to a common factor, which the Gaussians absorb, so their means are held
// at 0. The pull is proportional below the bend and constant above it, so that it does not outweigh the images.
inline constexpr double kIspExposureMean = 1.0, kIspExposureBend = 0.1;
inline constexpr double kIspColorMean = 1.0, kIspColorBend = 0.005;
// A lens darkens towards the edge (alpha <= 0), around the middle of the image, equally for all colours. A camera's
// response is nearly the same for all colours.
inline constexpr double kIspVignetteCentre = 0.02, kIspVignettePositive = 0.01, kIspVignetteVariance = 0.1,
                        kIspResponseVariance = 0.1;

/// Returns the slope of smooth L1, which is x^2 / (2 bend) near 0 and |x| - bend/2 beyond.
template <class Real> GS_HD Real smooth_l1_slope(Real x, Real bend) { return gs_clamp(x / bend, Real(-1), Real(1)); }

/// Computes the gradient of the frame terms, which is the same for each frame, from the means of the raw values over
/// all frames. Both have kIspFrameValues values.
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

/// Returns the gradient of the camera terms for value `k` of one camera with raw values `raw` (kIspCameraValues).
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
