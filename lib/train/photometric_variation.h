// SPDX-License-Identifier: Apache-2.0
// Measures whether photographs differ in ways that no scene explains: exposure, white balance.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// With --ppisp auto the correction is on if the images vary by more than this, in stops. The value is the geometric
/// middle between the scenes whose images are known to be alike (0.02 to 0.05; the largest are lego, and builtin:shadow
/// with its moving shadow) and the lowest of the others (bonsai 0.11; builtin:exposure 0.53).
inline constexpr double kPhotometricThreshold = 0.075;

struct PhotometricVariation {
    double stops = 0;             ///< standard deviation over the images of the brightness common to a whole image
    int num_images = 0;           ///< number of images compared
    std::string nothing_to_tell;  ///< reason why there is no figure; empty if there is one
};

/// Compares up to 64 training images, spread over the scene, with renders of a model whose colour does not depend on
/// the view and which so cannot follow single images. Measures how much brighter or darker whole images are than their
/// render, per channel.
///
/// An image is cut into 4x4 blocks; each gives log2(sum of the image / sum of the render). The part that all images
/// have in common at a block (vignetting, a model that is still too dark) is subtracted. An exposure moves all blocks
/// of an image alike; an error of geometry or a highlight moves some. So the variance between images, less the part
/// that the scatter within them accounts for, is that of exposure and white balance. `stops` is its root, root mean
/// square over the channels. Masked and transparent pixels do not count.
PhotometricVariation measure_variation(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                                       const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image);

}  // namespace gs
