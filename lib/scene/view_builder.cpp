// SPDX-License-Identifier: Apache-2.0
// Turns a source image with its lens into a view: a pinhole camera at the training size and a function that loads the
// pixels.
#include "lib/scene/view_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/io/orientation.h"
#include "lib/scene/resized.h"
#include "lib/scene/undistort.h"

namespace gs {
namespace {

// The default width of 3DGS, pixels. Larger photographs cost time there without a visible gain.
constexpr int kDefaultMaxWidth = 1600;

/// All data that a loader thread needs, held by value.
struct LoadJob {
    SourceView source;
    Camera pinhole;  ///< after undistortion, before resizing
    int width, height;
    AlphaMode alpha_mode;
    MaskMode mask_mode;
    bool invert_masks;

    ViewImage operator()() const {
        Image color = upright(read_image(source.image_path), source.turn);
        if (color.width != source.info.width || color.height != source.info.height)
            throw DataError(fmt::format("image {}: is {}x{} now but was {}x{} when the scene was loaded",
                                        source.image_path.string(), color.width, color.height, source.info.width,
                                        source.info.height));
        std::optional<Image> mask;
        if (source.mask) mask = load_mask(*source.mask, invert_masks, color.width, color.height, source.turn);
        ViewImage view = combine(std::move(color), std::move(mask), alpha_mode, mask_mode);
        if (!is_pinhole(source.lens)) view = undistort(view, source.lens, pinhole);
        return resized(std::move(view), width, height);
    }
};

int scaled_size(int size, double divisor) { return std::max(1, int(std::lround(size / divisor))); }

}  // namespace

std::pair<int, int> ViewBuilder::training_size(int width, int height) {
    const int resolution = prescaled_ > 1 ? 1 : options_.resolution;
    if (resolution == 1) return {width, height};
    if (resolution == 2 || resolution == 4 || resolution == 8)
        return {scaled_size(width, resolution), scaled_size(height, resolution)};
    const int target = resolution == -1 ? kDefaultMaxWidth : resolution;
    if (width <= target) {
        kept_small_ += resolution != -1 && width < target;
        return {width, height};
    }
    capped_ += resolution == -1;
    return {target, scaled_size(height, double(width) / target)};
}

View ViewBuilder::build(const SourceView& source) {
    Camera camera = source.pinhole;
    camera.rotation = source.rotation;
    camera.translation = source.translation;
    const bool distorted = !is_pinhole(source.lens);
    if (distorted && undistorted_++ == 0) undistorted_model_ = camera_model_info(source.lens.model).name;

    const auto [width, height] = training_size(camera.width, camera.height);
    LoadJob job{source, camera, width, height, options_.alpha_mode, options_.mask_mode, options_.invert_masks};
    if (width != camera.width || height != camera.height) {
        if (resized_++ == 0)
            resized_example_ =
                fmt::format("{} from {}x{} to {}x{}", source.name, camera.width, camera.height, width, height);
        camera = resized(camera, width, height);
    }

    const bool mask_to_alpha = source.mask && options_.mask_mode == MaskMode::kTransparent;
    const bool alpha_to_mask = source.info.channels == 4 && options_.alpha_mode == AlphaMode::kMask;
    const bool alpha = (source.info.channels == 4 && !alpha_to_mask) || mask_to_alpha ||
                       (alpha_to_mask && options_.mask_mode == MaskMode::kTransparent);
    const bool mask = (source.mask || alpha_to_mask) && options_.mask_mode != MaskMode::kTransparent;
    has_alpha_ = has_alpha_ || alpha;
    View view;
    view.name = source.name;
    view.camera = camera;
    view.camera_id = source.camera_id;
    if (source.mask) view.mask_file = source.mask->path.string();
    view.image_bytes =
        std::size_t(width) * height * ((alpha ? 4 : 3) * (source.info.float_data ? 4 : 1) + (mask ? 1 : 0));
    view.load = std::move(job);
    return view;
}

std::vector<std::string> ViewBuilder::notes() const {
    std::vector<std::string> lines;
    if (undistorted_ > 0)
        lines.push_back(fmt::format("{} images with lens distortion ({}): undistorted to pinhole when loaded",
                                    undistorted_, undistorted_model_));
    if (capped_ > 0)
        lines.push_back(
            fmt::format("{} images are wider than {} px: resized with a box filter ({}); -r 1 keeps the full size",
                        capped_, kDefaultMaxWidth, resized_example_));
    if (kept_small_ > 0)
        lines.push_back(
            fmt::format("{} images are narrower than {} px: not enlarged", kept_small_, options_.resolution));
    return lines;
}

std::vector<std::string> ViewBuilder::facts() const {
    if (resized_ == 0 || capped_ > 0) return {};
    return {fmt::format(
        "{} images resized with a box filter ({}): their scores do not compare with those on ready-made smaller images",
        resized_, resized_example_)};
}

}  // namespace gs
