// SPDX-License-Identifier: Apache-2.0
// Computes LDR-FLIP with a colour pipeline and a feature pipeline over separable filters.
#include "eval/metrics/flip.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "eval/metrics/pixel_metrics.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"

namespace gs {
namespace {

using Colour = std::array<double, 3>;
using Taps = std::vector<double>;  ///< an odd number of weights; the middle one belongs to the pixel itself

/// Exponents of colour and feature differences, and the knee of the curve that maps colour differences to [0,1].
/// Source: section 4 of the paper.
constexpr double kColourExponent = 0.7, kFeatureExponent = 0.5, kBendAt = 0.4, kBendValue = 0.95;
/// Width of the human edge detector, in degrees. Source: section 4.2.
constexpr double kFeatureWidth = 0.082;

/// White point of the standard illuminant D65, and the matrices from linear rgb to XYZ and back.
constexpr Colour kWhite = {0.950428545, 1.0, 1.088900371};
constexpr double kXyzFromRgb[3][3] = {{10135552 / 24577794.0, 8788810 / 24577794.0, 4435075 / 24577794.0},
                                      {2613072 / 12288897.0, 8788810 / 12288897.0, 887015 / 12288897.0},
                                      {1425312 / 73733382.0, 8788810 / 73733382.0, 70074185 / 73733382.0}};
constexpr double kRgbFromXyz[3][3] = {{3.241003275, -1.537398934, -0.498615861},
                                      {-0.969224334, 1.875930071, 0.041554224},
                                      {0.055639423, -0.204011202, 1.057148933}};

Colour product(const double (&m)[3][3], const Colour& v) {
    Colour out{};
    for (int i = 0; i < 3; ++i) out[i] = m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2];
    return out;
}

double linear_from_srgb(double v) { return v > 0.04045 ? std::pow((v + 0.055) / 1.055, 2.4) : v / 12.92; }

/// Converts to the opponent space YCxCz, which is linear in light and for which contrast sensitivity is known.
Colour ycxcz_from_rgb(const Colour& rgb) {
    const Colour xyz = product(kXyzFromRgb, rgb);
    const double x = xyz[0] / kWhite[0], y = xyz[1] / kWhite[1], z = xyz[2] / kWhite[2];
    return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

Colour rgb_from_ycxcz(const Colour& c) {
    const double y = (c[0] + 16) / 116;
    return product(kRgbFromXyz, {(y + c[1] / 500) * kWhite[0], y * kWhite[1], (y - c[2] / 200) * kWhite[2]});
}

/// Converts to CIELAB with chroma scaled by lightness, because dark colours look less colourful (Hunt effect).
Colour hunt_lab_from_rgb(const Colour& rgb) {
    const Colour xyz = product(kXyzFromRgb, rgb);
    Colour f{};
    constexpr double kDelta = 6.0 / 29;
    for (int i = 0; i < 3; ++i) {
        const double t = xyz[i] / kWhite[i];
        f[i] = t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
    }
    const double lightness = 116 * f[1] - 16;
    return {lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])};
}

/// Returns the absolute difference of lightness plus the Euclidean distance of chroma.
double hyab(const Colour& a, const Colour& b) { return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]); }

struct Plane {
    int width, height;
    std::vector<double> values;
    Plane(int w, int h) : width(w), height(h), values(std::size_t(w) * h) {}
};

/// Correlates with one set of taps along x, then with another along y. Borders are replicated.
Plane filtered(const Plane& in, const Taps& along_x, const Taps& along_y) {
    const int rx = int(along_x.size() / 2), ry = int(along_y.size() / 2);
    Plane rows(in.width, in.height), out(in.width, in.height);
    parallel_for(in.height, [&](std::int64_t y) {
        const double* from = &in.values[std::size_t(y) * in.width];
        Taps padded(std::size_t(in.width + 2 * rx));
        for (int x = 0; x < int(padded.size()); ++x) padded[x] = from[std::clamp(x - rx, 0, in.width - 1)];
        double* to = &rows.values[std::size_t(y) * in.width];
        for (int k = 0; k <= 2 * rx; ++k) {
            for (int x = 0; x < in.width; ++x) to[x] += along_x[k] * padded[x + k];
        }
    });
    parallel_for(in.height, [&](std::int64_t y) {
        double* to = &out.values[std::size_t(y) * in.width];
        for (int k = 0; k <= 2 * ry; ++k) {
            const double* from = &rows.values[std::size_t(std::clamp(int(y) + k - ry, 0, in.height - 1)) * in.width];
            for (int x = 0; x < in.width; ++x) to[x] += along_y[k] * from[x];
        }
    });
    return out;
}

Taps taps(int radius, const std::function<double(double)>& value) {
    Taps out;
    for (int i = -radius; i <= radius; ++i) out.push_back(value(i));
    return out;
}

double sum(const Taps& taps) {
    double total = 0;
    for (const double t : taps) total += t;
    return total;
}

void scale(Taps& taps, double factor) {
    for (double& t : taps) t *= factor;
}

/// One term a sqrt(pi/b) exp(-pi^2 x^2 / b) of a contrast sensitivity function, x in degrees. Source: table 1 of the
/// paper.
struct CsfTerm {
    double a, b;
};
const std::array<std::vector<CsfTerm>, 3> kCsf = {{{{1, 0.0047}}, {{1, 0.0053}}, {{34.1, 0.04}, {13.5, 0.025}}}};
constexpr double kWidestB = 0.04;  ///< largest b; three of its deviations are the radius of all filters

/// Filters a channel by its contrast sensitivity function, a sum of Gaussians. Each Gaussian is separable, their sum is
/// not.
Plane seen(const Plane& in, const std::vector<CsfTerm>& terms, double ppd) {
    const double pi = std::numbers::pi;
    const int radius = int(std::ceil(3 * std::sqrt(kWidestB / (2 * pi * pi)) * ppd));
    Plane out(in.width, in.height);
    std::vector<Taps> gaussians;
    std::vector<double> weights;
    double total = 0;
    for (const CsfTerm& term : terms) {
        gaussians.push_back(taps(radius, [&](double x) { return std::exp(-pi * pi * x * x / (ppd * ppd * term.b)); }));
        weights.push_back(term.a * std::sqrt(pi / term.b));
        total += weights.back() * sum(gaussians.back()) * sum(gaussians.back());
    }
    for (std::size_t i = 0; i < terms.size(); ++i) {
        const Plane part = filtered(in, gaussians[i], gaussians[i]);
        for (std::size_t p = 0; p < out.values.size(); ++p) out.values[p] += weights[i] / total * part.values[p];
    }
    return out;
}

/// Returns the three planes of an image in YCxCz.
std::array<Plane, 3> opponent_planes(const Image& image) {
    const Plane empty(image.width, image.height);
    std::array<Plane, 3> planes = {empty, empty, empty};
    parallel_for(image.height, [&](std::int64_t y) {
        for (int x = 0; x < image.width; ++x) {
            Colour rgb{};
            for (int c = 0; c < 3; ++c)
                rgb[c] = linear_from_srgb(std::clamp(double(image.value(x, int(y), c)), 0.0, 1.0));
            const Colour opponent = ycxcz_from_rgb(rgb);
            for (int c = 0; c < 3; ++c) planes[c].values[std::size_t(y) * image.width + x] = opponent[c];
        }
    });
    return planes;
}

/// Returns the input of the colour comparison: filtered colours, clamped to displayable ones, in scaled CIELAB.
std::vector<Colour> perceived_colours(const std::array<Plane, 3>& opponent, double ppd) {
    const Plane y = seen(opponent[0], kCsf[0], ppd), cx = seen(opponent[1], kCsf[1], ppd),
                cz = seen(opponent[2], kCsf[2], ppd);
    std::vector<Colour> colours(y.values.size());
    parallel_for_rows(std::int64_t(colours.size()), [&](std::int64_t p) {
        Colour rgb = rgb_from_ycxcz({y.values[p], cx.values[p], cz.values[p]});
        for (double& v : rgb) v = std::clamp(v, 0.0, 1.0);
        colours[p] = hunt_lab_from_rgb(rgb);
    });
    return colours;
}

/// Strength of edges and points in each pixel.
struct Features {
    std::vector<double> edges, points;
};

std::vector<double> strength(const Plane& luminance, const Taps& along, const Taps& across) {
    const Plane dx = filtered(luminance, along, across), dy = filtered(luminance, across, along);
    std::vector<double> out(dx.values.size());
    for (std::size_t p = 0; p < out.size(); ++p) out[p] = std::hypot(dx.values[p], dy.values[p]);
    return out;
}

Features features(const Plane& y, double ppd) {
    Plane luminance = y;
    for (double& v : luminance.values) v = (v + 16) / 116;
    const double deviation = 0.5 * kFeatureWidth * ppd;
    const int radius = int(std::ceil(3 * deviation));
    const auto gaussian = [&](double x) { return std::exp(-x * x / (2 * deviation * deviation)); };
    Taps across = taps(radius, gaussian);
    scale(across, 1 / sum(across));
    // Scales the positive and the negative weights of a derivative so that each sum to one.
    const auto balanced = [](Taps taps) {
        double positive = 0, negative = 0;
        for (const double t : taps) (t > 0 ? positive : negative) += std::abs(t);
        for (double& t : taps) t /= t > 0 ? positive : negative;
        return taps;
    };
    const Taps edge = balanced(taps(radius, [&](double x) { return -x * gaussian(x); }));
    const Taps point =
        balanced(taps(radius, [&](double x) { return (x * x / (deviation * deviation) - 1) * gaussian(x); }));
    return {strength(luminance, edge, across), strength(luminance, point, across)};
}

/// Maps a colour difference, raised to the power of kColourExponent, to [0,1]. Most of the range is used for
/// differences below kBendAt of the largest.
double redistributed(double difference, double largest) {
    const double bend = kBendAt * largest;
    if (difference < bend) return kBendValue / bend * difference;
    return kBendValue + (difference - bend) / (largest - bend) * (1 - kBendValue);
}

}  // namespace

std::vector<double> flip_map(const Image& a, const Image& b, double pixels_per_degree) {
    require_same_size(a, b);
    if (a.channels != 3) throw UsageError(fmt::format("FLIP compares rgb images, not {} channels", a.channels));
    if (!(pixels_per_degree >= 1 && pixels_per_degree <= 1000))
        throw UsageError(fmt::format("FLIP at {} pixels per degree: not in [1, 1000]", pixels_per_degree));
    const std::array<Plane, 3> oa = opponent_planes(a), ob = opponent_planes(b);
    const std::vector<Colour> ca = perceived_colours(oa, pixels_per_degree),
                              cb = perceived_colours(ob, pixels_per_degree);
    const Features fa = features(oa[0], pixels_per_degree), fb = features(ob[0], pixels_per_degree);
    // Green and blue differ more than any other two displayable colours.
    const double largest = std::pow(hyab(hunt_lab_from_rgb({0, 1, 0}), hunt_lab_from_rgb({0, 0, 1})), kColourExponent);
    std::vector<double> map(ca.size());
    parallel_for_rows(std::int64_t(map.size()), [&](std::int64_t p) {
        const double colour = redistributed(std::pow(hyab(ca[p], cb[p]), kColourExponent), largest);
        const double feature = std::max(std::abs(fa.edges[p] - fb.edges[p]), std::abs(fa.points[p] - fb.points[p]));
        map[p] = std::pow(colour, 1 - std::pow(feature / std::numbers::sqrt2, kFeatureExponent));
    });
    return map;
}

double flip(const Image& a, const Image& b, double pixels_per_degree) {
    const std::vector<double> map = flip_map(a, b, pixels_per_degree);
    return sum(map) / double(map.size());
}

std::string describe_flip(double pixels_per_degree) {
    return fmt::format("LDR-FLIP, {:.2f} pixels per degree, mean over all pixels", pixels_per_degree);
}

}  // namespace gs
