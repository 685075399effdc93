// SPDX-License-Identifier: Apache-2.0
// Photographs in memory, for renders of several models to be compared with, and which of them are held out where test
// views must not be looked at.
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

/// Every n-th training view is held out, beginning in the middle of the first n.
inline constexpr std::size_t kHeldOutEvery = 8;
inline bool is_held_out(std::size_t view) { return view % kHeldOutEvery == kHeldOutEvery / 2; }
/// With fewer training views than this none can be held out.
inline constexpr std::size_t kFewestViews = kHeldOutEvery;

struct Photograph {
    Camera camera;
    int camera_id = 0;
    std::vector<std::int32_t> pixels;  ///< those that count, ascending: y * camera.width + x
    Image colors;                      ///< colours of these pixels in one row, 8-bit rgb on the background
};

/// Returns the image of view k, which is in memory already. Called from several threads.
using ImageOf = std::function<std::shared_ptr<const ViewImage>(std::size_t k)>;

/// Reads the photographs through `image`, or from their files if there is none. Views whose mask lets no pixel count
/// are left out. Throws what View::load throws.
std::vector<Photograph> load_photographs(const std::vector<View>& views, const Vec3<float>& background,
                                         const ImageOf& image = {});

/// Renders the pixels that count, in one row, with neutral exposure and colour. `alpha` is filled as well.
RenderedImage render_pixels(Backend& backend, const Photograph& photograph, const Vec3<float>& background);

/// Returns the mean squared difference over pixels and channels, with both colours clamped to [0,1].
double mean_squared_error(const RenderedImage& pixels, const Photograph& photograph);

/// Applies the affine map of colours that brings the render closest to the photograph.
void align_colours(RenderedImage& pixels, const Photograph& photograph);

/// Returns the PSNR of each photograph, dB, with the colours of each render aligned first if `aligned`. A render that
/// is as near as the 8 bits of a photograph can tell counts 58.9 dB.
std::vector<double> psnrs(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                          bool aligned);

/// Returns the mean of these; NaN without photographs.
double mean_psnr(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                 bool aligned);

}  // namespace gs
