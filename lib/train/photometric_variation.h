// SPDX-License-Identifier: Apache-2.0
// Whether photographs differ in ways that no scene explains: exposure, white balance.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Of --ppisp auto: correction is on where the images vary by more than this, in stops. Half way, in ratio, between the scenes whose
/// images are known to be alike (0.02 to 0.05; the largest are lego, and builtin:shadow with its moving shadow) and the first whose
/// are not (bonsai 0.11; builtin:exposure 0.53).
inline constexpr double kPhotometricThreshold = 0.075;

struct PhotometricVariation {
    double stops = 0;     ///< standard deviation over the images of what is common to a whole image
    int num_images = 0;   ///< looked at
    std::string nothing_to_tell;  ///< why there is no figure, in words; empty where there is one
};

/// Compares up to 64 training images, spread over the scene, with renders of a model that cannot follow them one by one (colour
/// independent of the view), and measures how far whole images are brighter or darker than their render, per channel.
///
/// An image is cut into 4x4 blocks; each gives log2(sum of the image / sum of the render). What all images have in common at a
/// block (vignetting, a model that is still too dark) is subtracted. An exposure moves all blocks of an image alike, an error of
/// geometry or a highlight moves some: the variance between images, less what the scatter within them accounts for, is that of
/// exposure and white balance. Returned is its root, root mean square over the channels. Masked and transparent pixels do not count.
PhotometricVariation measure_variation(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                                       const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image);

}  // namespace gs
