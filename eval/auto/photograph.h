// SPDX-License-Identifier: Apache-2.0
// Photographs in memory, for comparison with renders of several models, and the choice of held-out training views for
// measurements that must not use test views.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

/// Stride of held-out training views, starting in the middle of the first stride.
inline constexpr std::size_t kHeldOutEvery = 8;
inline bool is_held_out(std::size_t view) { return view % kHeldOutEvery == kHeldOutEvery / 2; }
/// Fewest training views from which some can be held out.
inline constexpr std::size_t kFewestViews = kHeldOutEvery;

struct Photograph {
    Camera camera;
    int camera_id = 0;
    std::vector<std::int32_t> pixels;  ///< pixels that count, ascending: y * camera.width + x
    Image colors;                      ///< colours of these pixels in one row, 8-bit rgb on the background
};

/// Returns the image of view k, which is in memory already. Called from several threads.
using ImageOf = std::function<std::shared_ptr<const ViewImage>(std::size_t k)>;

/// Reads the photographs through `image`, or from their files if it is empty. Views whose mask excludes every pixel are
/// left out. Throws the errors of View::load.
std::vector<Photograph> load_photographs(const std::vector<View>& views, const Vec3<float>& background,
                                         const ImageOf& image = {});

/// Renders the pixels that count, in one row, with neutral exposure and colour. Also fills `alpha`.
RenderedImage render_pixels(Backend& backend, const Photograph& photograph, const Vec3<float>& background);

/// Returns the mean squared difference over pixels and channels, with both colours clamped to [0,1].
double mean_squared_error(const RenderedImage& pixels, const Photograph& photograph);

/// Applies the affine colour map that brings the render closest to the photograph.
void align_colours(RenderedImage& pixels, const Photograph& photograph);

/// Returns the PSNR of each photograph, dB, with the colours of each render aligned first if `aligned`. A render within
/// the rounding of an 8-bit photograph scores 58.9 dB.
std::vector<double> psnrs(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                          bool aligned);

/// Returns the mean of psnrs(); NaN without photographs.
double mean_psnr(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                 bool aligned);

}  // namespace gs
