// SPDX-License-Identifier: Apache-2.0
// Removes lens distortion, and builds views from images.
#include "lib/scene/view_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/io/image.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

using Eigen::Vector2d;

// The largest tangent of a ray's angle to the axis (84 degrees). Steeper rays would stretch a pinhole image beyond use,
// so the borders ignore them.
constexpr double kMaxTangent = 10;

/// Returns the position of a source pixel in the pinhole image with the same intrinsics.
std::optional<Vector2d> trace(const LensCamera& lens, double x, double y) {
    const auto ray = unproject(lens, {x, y});
    if (!ray || std::hypot(ray->x(), ray->y()) > kMaxTangent * ray->z()) return {};
    return Vector2d(lens.fx * ray->x() / ray->z() + lens.cx, lens.fy * ray->y() / ray->z() + lens.cy);
}

/// Returns the size factor of one axis: the distance of the innermost traced borders from the principal point, relative
/// to the distance of the original borders. Throws DataError for folded borders.
double axis_scale(double center, int size, double low_max, double high_min, const std::string& where) {
    const double low = center - low_max, high = high_min - center;
    if (!(low > 0 && high > 0))
        throw DataError(fmt::format(
            "{}: the distortion folds the image over its principal point; its parameters are damaged", where));
    const double shrink = std::max(center / low, (size - 0.5 - center) / high);
    return std::clamp(1 / shrink, 0.2, 2.0);
}

/// Samples all channels bilinearly at a pixel position inside the image. Colour is premultiplied by alpha if the image
/// has an alpha channel.
void sample(const Image& image, double px, double py, float* out) {
    const double x = std::clamp(px - 0.5, 0.0, image.width - 1.0), y = std::clamp(py - 0.5, 0.0, image.height - 1.0);
    const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
    const float fx = float(x - x0), fy = float(y - y0);
    const int xs[4] = {x0, x1, x0, x1}, ys[4] = {y0, y0, y1, y1};
    const float weights[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
    std::fill_n(out, image.channels, 0.0f);
    for (int k = 0; k < 4; ++k) {
        const float alpha = image.channels == 4 ? image.value(xs[k], ys[k], 3) : 1.0f;
        for (int c = 0; c < image.channels; ++c)
            out[c] += weights[k] * image.value(xs[k], ys[k], c) * (c < 3 ? alpha : 1.0f);
    }
    if (image.channels == 4)
        for (int c = 0; c < 3; ++c) out[c] = out[3] > 0 ? out[c] / out[3] : 0;
}

void store(Image& image, int x, int y, const float* values) {
    const std::size_t i = (std::size_t(y) * image.width + x) * image.channels;
    for (int c = 0; c < image.channels; ++c) {
        if (image.is_float())
            image.f32[i + c] = values[c];
        else
            image.u8[i + c] = to_8_bits(values[c]);
    }
}

Image blank(int width, int height, int channels, bool is_float) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    const std::size_t samples = std::size_t(width) * height * channels;
    if (is_float)
        image.f32.assign(samples, 0.0f);
    else
        image.u8.assign(samples, 0);
    return image;
}

// The default maximum width of 3DGS, pixels. Larger photographs cost time in 3DGS without a visible gain.
constexpr int kDefaultMaxWidth = 1600;

/// Makes the pixels that the lens does not see black, and weighs the loss of all by the solid angle that they see.
void weigh_by_lens(const Image& weights, ViewImage& view) {
    if (!view.mask)
        view.mask = Image{weights.width, weights.height, 1, std::vector<std::uint8_t>(weights.u8.size(), 255), {}};
    float nothing[4] = {0, 0, 0, 1};
    for (int y = 0; y < weights.height; ++y)
        for (int x = 0; x < weights.width; ++x) {
            const std::uint8_t weight = weights.u8[std::size_t(y) * weights.width + x];
            if (weight == 255) continue;
            if (weight == 0) store(view.color, x, y, nothing);
            const float masked = float(weight) / 255 * view.mask->value(x, y, 0);
            store(*view.mask, x, y, &masked);
        }
}

/// All data that a loader thread needs, stored by value.
struct LoadJob {
    SourceView source;
    Camera camera;                         ///< before resizing
    std::shared_ptr<const Image> weights;  ///< of the lens, as in View
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
        if (is_pinhole(camera) && !is_pinhole(source.lens))
            view = undistort(view, Camera{source.lens, {std::numbers::pi}}, camera);
        view = resized(std::move(view), width, height);
        if (weights) weigh_by_lens(*weights, view);
        return view;
    }
};

/// Returns the observations of a source image that lie in the image of `camera`, which may be undistorted.
std::vector<PointObservation> observations_in(const Camera& camera, const SourceView& source) {
    if (is_pinhole(source.lens) || !is_pinhole(camera)) return source.observations;
    std::vector<PointObservation> out;
    for (const PointObservation& seen : source.observations) {
        const auto ray = unproject(source.lens, {seen.at.x() * source.lens.width, seen.at.y() * source.lens.height});
        const auto at = ray ? project(camera, *ray) : std::nullopt;
        if (!at) continue;
        const Eigen::Vector2d share(at->x() / camera.width, at->y() / camera.height);
        if ((share.array() >= 0).all() && (share.array() <= 1).all()) out.push_back({seen.point, share});
    }
    return out;
}

int scaled_size(int size, double divisor) { return std::max(1, int(std::lround(size / divisor))); }

}  // namespace

Camera undistorted_camera(const LensCamera& lens, const std::string& where) {
    Camera camera;
    camera.width = lens.width;
    camera.height = lens.height;
    camera.fx = lens.fx;
    camera.fy = lens.fy;
    camera.cx = lens.cx;
    camera.cy = lens.cy;
    if (is_pinhole(lens)) return camera;
    if (lens.model == CameraModel::kEquirectangular)
        throw DataError(fmt::format("{}: camera model EQUIRECTANGULAR has no pinhole image: use --lens native", where));

    if (!(lens.cx > 0 && lens.cx < lens.width && lens.cy > 0 && lens.cy < lens.height))
        throw DataError(
            fmt::format("{}: the principal point ({:g}, {:g}) of a distorted camera lies outside its {}x{} image",
                        where, lens.cx, lens.cy, lens.width, lens.height));

    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double left = -kInfinity, right = kInfinity, top = -kInfinity, bottom = kInfinity;
    for (int y = 0; y < lens.height; ++y) {
        if (const auto p = trace(lens, 0.5, y + 0.5)) left = std::max(left, p->x());
        if (const auto p = trace(lens, lens.width - 0.5, y + 0.5)) right = std::min(right, p->x());
    }
    for (int x = 0; x < lens.width; ++x) {
        if (const auto p = trace(lens, x + 0.5, 0.5)) top = std::max(top, p->y());
        if (const auto p = trace(lens, x + 0.5, lens.height - 0.5)) bottom = std::min(bottom, p->y());
    }
    for (const double border : {left, right, top, bottom})
        if (!std::isfinite(border))
            throw DataError(fmt::format(
                "{}: no ray within 84 degrees of the axis reaches one of the borders; {}", where,
                is_plane_polynomial(lens.model)
                    ? "the distortion folds the image before them: its parameters are damaged"
                    : fmt::format(
                          "camera model {} sees nearly 180 degrees or more: convert the images to a narrower view "
                          "first",
                          camera_model_info(lens.model).name)));

    camera.width = int(std::max(1.0, axis_scale(lens.cx, lens.width, left, right, where) * lens.width));
    camera.height = int(std::max(1.0, axis_scale(lens.cy, lens.height, top, bottom, where) * lens.height));
    camera.cx *= double(camera.width) / lens.width;
    camera.cy *= double(camera.height) / lens.height;
    return camera;
}

Camera choose_camera(const LensCamera& lens, LensMode mode, const std::string& where) {
    if (mode == LensMode::kUndistort || is_pinhole(lens)) return undistorted_camera(lens, where);
    if (mode == LensMode::kAuto) {
        try {
            return undistorted_camera(lens, where);
        } catch (const DataError&) {
            // There is no pinhole image of this lens.
        }
    }
    Camera camera;
    static_cast<LensCamera&>(camera) = lens;
    camera.range = lens_range(lens);
    constexpr double kLeastAngle = 0.01;
    if (!(camera.range.max_angle >= kLeastAngle))
        throw DataError(
            fmt::format("{}: the distortion of the lens ({}) folds the image {:.2g} degrees from its axis; "
                        "its parameters are damaged",
                        where, camera_model_info(lens.model).name, camera.range.max_angle * 180 / std::numbers::pi));
    return camera;
}

std::shared_ptr<const Image> lens_weights(const Camera& lens) {
    auto weights = std::make_shared<Image>(blank(lens.width, lens.height, 1, false));
    if (lens.model == CameraModel::kEquirectangular) {
        // The area of a pixel on the sphere falls with the cosine of its latitude.
        for (int y = 0; y < lens.height; ++y) {
            const double share = std::sin(std::numbers::pi * (y + 0.5) / lens.height);
            std::fill_n(&weights->u8[std::size_t(y) * lens.width], lens.width,
                        std::uint8_t(1 + std::lround(254 * share)));
        }
        return weights;
    }
    const double least = std::cos(lens.range.max_angle);
    parallel_for(lens.height, [&](std::int64_t y) {
        for (int x = 0; x < lens.width; ++x) {
            const auto ray = unproject(lens, {x + 0.5, double(y) + 0.5});
            if (ray && ray->z() >= least) weights->u8[std::size_t(y) * lens.width + x] = 255;
        }
    });
    if (std::find(weights->u8.begin(), weights->u8.end(), 0) == weights->u8.end()) return nullptr;
    return weights;
}

ViewImage undistort(const ViewImage& in, const Camera& lens, const Camera& pinhole,
                    const Eigen::Matrix3d& lens_from_pinhole) {
    ViewImage out;
    out.color = blank(pinhole.width, pinhole.height, in.color.channels, in.color.is_float());
    Image mask = blank(pinhole.width, pinhole.height, 1, false);
    bool all_valid = true;
    float values[4];
    for (int y = 0; y < pinhole.height; ++y)
        for (int x = 0; x < pinhole.width; ++x) {
            const Eigen::Vector3d ray((x + 0.5 - pinhole.cx) / pinhole.fx, (y + 0.5 - pinhole.cy) / pinhole.fy, 1);
            const Eigen::Vector3d direction = lens_from_pinhole * ray;
            const auto source = project(lens, direction);
            if (!source || !lens.is_used_at(direction) ||
                !(source->x() >= 0 && source->y() >= 0 && source->x() <= lens.width && source->y() <= lens.height)) {
                all_valid = false;
                continue;
            }
            sample(in.color, source->x(), source->y(), values);
            store(out.color, x, y, values);
            values[0] = 1;
            if (in.mask) sample(*in.mask, source->x(), source->y(), values);
            store(mask, x, y, values);
        }
    if (in.mask || !all_valid) out.mask = std::move(mask);
    return out;
}

std::pair<int, int> ViewBuilder::training_size(int width, int height) {
    const std::optional<int> resolution = prescaled_ > 1 ? 1 : options_.resolution;
    if (resolution == 1) return {width, height};
    if (resolution == 2 || resolution == 4 || resolution == 8)
        return {scaled_size(width, *resolution), scaled_size(height, *resolution)};
    const int target = resolution.value_or(kDefaultMaxWidth);
    if (width <= target) {
        kept_small_ += resolution && width < target;
        return {width, height};
    }
    capped_ += !resolution;
    return {target, scaled_size(height, double(width) / target)};
}

std::shared_ptr<const Image> ViewBuilder::weights_of(const Camera& lens) {
    if (static_cast<const LensCamera&>(lens) != static_cast<const LensCamera&>(last_lens_)) {
        weights_ = lens_weights(lens);
        last_lens_ = lens;
    }
    if (weights_) {
        const auto unseen = std::size_t(std::count(weights_->u8.begin(), weights_->u8.end(), 0));
        partly_seen_ += unseen > 0;
        least_seen_ = std::min(least_seen_, 1 - double(unseen) / double(weights_->u8.size()));
    }
    return weights_;
}

View ViewBuilder::build(const SourceView& source) {
    Camera camera = source.camera;
    camera.rotation = source.rotation;
    camera.translation = source.translation;
    const bool native = !is_pinhole(camera), distorted = !native && !is_pinhole(source.lens);
    if (distorted && undistorted_++ == 0) undistorted_model_ = camera_model_info(source.lens.model).name;
    if (native && native_++ == 0) native_model_ = camera_model_info(source.lens.model).name;

    const auto [width, height] = training_size(camera.width, camera.height);
    const Camera full = camera;
    if (width != camera.width || height != camera.height) {
        if (resized_++ == 0)
            resized_example_ =
                fmt::format("{} from {}x{} to {}x{}", source.name, camera.width, camera.height, width, height);
        camera = resized(camera, width, height);
    }
    const std::shared_ptr<const Image> weights = native ? weights_of(camera) : nullptr;
    LoadJob job{source, full, weights, width, height, options_.alpha_mode, options_.mask_mode, options_.invert_masks};

    const bool mask_to_alpha = source.mask && options_.mask_mode == MaskMode::kTransparent;
    const bool alpha_to_mask = source.info.channels == 4 && options_.alpha_mode == AlphaMode::kMask;
    const bool alpha = (source.info.channels == 4 && !alpha_to_mask) || mask_to_alpha ||
                       (alpha_to_mask && options_.mask_mode == MaskMode::kTransparent);
    const bool mask = ((source.mask || alpha_to_mask) && options_.mask_mode != MaskMode::kTransparent) || weights;
    has_alpha_ = has_alpha_ || alpha;
    View view;
    view.name = source.name;
    view.camera = camera;
    view.lens_weights = weights;
    view.observations = observations_in(full, source);
    view.camera_id = source.camera_id;
    view.file = source.image_path, view.photograph = source.lens;
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
    if (native_ > 0)
        lines.push_back(fmt::format("{} images with lens distortion ({}): used as they are, through their own lens",
                                    native_, native_model_));
    if (partly_seen_ > 0)
        lines.push_back(
            fmt::format("{} images are used only in part ({:.0f} % at least): pixels outside of the largest circle in "
                        "which the lens is one to one, or without a ray, are left out",
                        partly_seen_, 100 * least_seen_));
    if (capped_ > 0)
        lines.push_back(
            fmt::format("{} images are wider than {} px: resized with a box filter ({}); -r 1 keeps the full size",
                        capped_, kDefaultMaxWidth, resized_example_));
    if (kept_small_ > 0)
        lines.push_back(
            fmt::format("{} images are narrower than {} px: not enlarged", kept_small_, *options_.resolution));
    return lines;
}

std::vector<std::string> ViewBuilder::facts() const {
    if (resized_ == 0 || capped_ > 0) return {};
    return {fmt::format(
        "{} images resized with a box filter ({}): their scores do not compare with those on ready-made smaller images",
        resized_, resized_example_)};
}

}  // namespace gs
