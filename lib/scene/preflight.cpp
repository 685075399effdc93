// SPDX-License-Identifier: Apache-2.0
// Checks a dataset before training: missing or unreadable files, mismatched sizes, points that no camera sees.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/splat/camera.h"
#include "lib/io/image.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/image_files.h"
#include "lib/scene/source_scene.h"

namespace gs {
namespace {

/// Numbers of points that no camera sees, and of points that cameras see but do not draw (Seen::kClipped).
struct PointCounts {
    std::atomic<std::int64_t> unseen = 0, clipped = 0;
};

void count_points(const std::vector<const View*>& views, const PointCloud& points, PointCounts& counts) {
    const std::int64_t count = std::int64_t(points.positions.size());
    parallel_for(num_parts(count), [&](std::int64_t part) {
        std::size_t last = 0;  // the same camera usually sees neighbours in the file
        for (std::int64_t i = part * kPartSize; i < std::min(count, (part + 1) * kPartSize); ++i) {
            Seen best = Seen::kNot;
            for (std::size_t tried = 0; tried < views.size(); ++tried) {
                best = std::max(best, seen(views[last]->camera, points.positions[std::size_t(i)].cast<double>()));
                if (best == Seen::kDrawn) break;
                last = (last + 1) % views.size();
            }
            counts.unseen += best == Seen::kNot;
            counts.clipped += best == Seen::kClipped;
        }
    });
}

/// Lists the views that draw no point.
std::vector<std::string> blind_views(const std::vector<const View*>& views, const PointCloud& points) {
    std::vector<char> blind(views.size());
    parallel_for_rows(std::int64_t(views.size()), [&](std::int64_t v) {
        blind[std::size_t(v)] =
            std::none_of(points.positions.begin(), points.positions.end(), [&](const Eigen::Vector3f& point) {
                return seen(views[std::size_t(v)]->camera, point.cast<double>()) == Seen::kDrawn;
            });
    });
    std::vector<std::string> names;
    for (std::size_t v = 0; v < views.size(); ++v)
        if (blind[v]) names.push_back(views[v]->name);
    return names;
}

}  // namespace

std::string listed(const std::vector<std::string>& items) {
    constexpr std::size_t kShown = 3;
    std::string text;
    for (std::size_t i = 0; i < std::min(items.size(), kShown); ++i) text += (i > 0 ? ", " : "") + items[i];
    if (items.size() > kShown) text += fmt::format(" and {} more", items.size() - kShown);
    return text;
}

bool Preflight::accept_file(SourceView& view, const FoundImage& image) {
    if (names_.contains(view.name)) {
        duplicate_.push_back(view.name);
        return false;
    }
    if (!image.file) {
        (image.is_contested ? contested_ : missing_).push_back(view.name);
        return false;
    }
    try {
        if (is_unread_photograph(*image.file))
            throw DataError(fmt::format("image {}: files of this format are not read; {}", image.file->string(),
                                        kConvertPhotographs));
        view.info = read_image_info(*image.file);
    } catch (const DataError& error) {
        unreadable_.push_back(error.what());
        if (unreadable_names_.insert(view.name).second) view.unreadable = error.what();
        return false;
    }
    view.image_path = *image.file;
    names_.insert(view.name);
    return true;
}

void Preflight::choose_turn(SourceView& view) {
    ImageInfo& info = view.info;
    if (info.orientation == 1) return;
    const bool lens_is_wide = view.lens.width > view.lens.height, lens_is_tall = view.lens.width < view.lens.height;
    const bool disagrees = (lens_is_wide && info.width < info.height) || (lens_is_tall && info.width > info.height);
    if (!is_quarter_turn(info.orientation) || !disagrees) {
        kept_.push_back(view.name);
        return;
    }
    turned_.push_back(view.name);
    view.turn = info.orientation;
    std::swap(info.width, info.height);
}

void Preflight::fit_lens(SourceView& view) {
    if (view.lens.width == view.info.width && view.lens.height == view.info.height) return;
    rescaled_.push_back(fmt::format("{} is {}x{}, its camera {}x{}", view.name, view.info.width, view.info.height,
                                    view.lens.width, view.lens.height));
    view.lens = scaled_to(view.lens, view.info.width, view.info.height);
}

std::vector<std::string> Preflight::report(const std::string& where) const {
    std::vector<std::string> lines;
    if (!missing_.empty())
        lines.push_back(fmt::format("{} images missing: skipped ({})", missing_.size(), listed(missing_)));
    if (!contested_.empty())
        lines.push_back(
            fmt::format("{} images are skipped, because their names do not tell which file is meant or mean "
                        "that of another image ({})",
                        contested_.size(), listed(contested_)));
    if (!cameras_.empty())
        lines.push_back(fmt::format("{} images are left out because their camera cannot be used (first: {})",
                                    cameras_.size(), cameras_[0]));
    if (!unreadable_.empty())
        lines.push_back(fmt::format("{} images unreadable: skipped ({})", unreadable_.size(), listed(unreadable_)));
    if (!duplicate_.empty())
        lines.push_back(fmt::format("{} image names appear more than once: the first is used ({})", duplicate_.size(),
                                    listed(duplicate_)));
    if (names_.size() <= cameras_.size()) {  // each view whose camera was rejected had been accepted before
        std::string reasons;
        for (const std::string& line : lines) reasons += "; " + line;
        throw DataError(
            fmt::format("{}: no usable image{}", where, reasons.empty() ? "; the file lists none" : reasons));
    }
    if (!turned_.empty())
        lines.push_back(
            fmt::format("{} images are turned by their EXIF orientation, as the sizes of their cameras ask ({})",
                        turned_.size(), listed(turned_)));
    if (!kept_.empty())
        lines.push_back(
            fmt::format("{} images have an EXIF orientation: ignored, because their cameras fit the pixels as "
                        "stored; pictures of the run show them so, perhaps on their side ({})",
                        kept_.size(), listed(kept_)));
    if (!rescaled_.empty())
        lines.push_back(fmt::format("{} images differ in size from their camera: intrinsics scaled per axis ({})",
                                    rescaled_.size(), rescaled_[0]));
    return lines;
}

void note_mask_findings(const MaskFinder& masks, const std::vector<std::string>& listed_as_images, SourceScene& scene) {
    if (!listed_as_images.empty())
        scene.notes.push_back(
            fmt::format("{} images are masks of others by their names: not taken for photographs ({})",
                        listed_as_images.size(), listed(listed_as_images)));
    if (std::any_of(scene.views.begin(), scene.views.end(), [](const SourceView& view) { return bool(view.mask); }))
        return;
    for (const std::filesystem::path& folder : masks.unused())
        scene.notes.push_back(
            fmt::format("{}: its files have the name of no image: not used as masks (the mask of left/a.jpg is "
                        "left/a.jpg.png, left/a.png, or one of these with .mask or _mask before .png)",
                        folder.string()));
}

void check_points(Scene& scene) {
    // Every reconstruction has some points just outside the undistorted images, which lens distortion had bent into the
    // photographs.
    constexpr double kFewPoints = 0.05;
    const std::size_t count = scene.points.positions.size();
    if (count == 0) return;
    std::vector<const View*> views;
    for (const auto* part : {&scene.train, &scene.test})
        for (const View& view : *part) views.push_back(&view);
    PointCounts counts;
    count_points(views, scene.points, counts);
    if (counts.unseen == std::int64_t(count)) {
        scene.notes.push_back(fmt::format(
            "none of the {} points projects into an image: kept, but poses and points do not fit together", count));
        return;
    }
    if (double(counts.unseen) > kFewPoints * double(count))
        scene.notes.push_back(fmt::format("{} of {} points project into no image: kept, but no image moves them",
                                          counts.unseen.load(), count));
    if (counts.clipped > 0) {
        const CameraParams<double> planes{};
        scene.notes.push_back(fmt::format(
            "{} of {} points lie in images only nearer than {:.3g} or farther than {:.3g} (the near and far planes, in "
            "the scene's units): kept, but not drawn there",
            counts.clipped.load(), count, planes.near_plane / scene.frame.scale, planes.far_plane / scene.frame.scale));
    }
    if (const auto blind = blind_views(views, scene.points); !blind.empty())
        scene.notes.push_back(
            fmt::format("{} of {} cameras see none of the {} points ({}): kept; are their poses right?", blind.size(),
                        views.size(), count, listed(blind)));
}

}  // namespace gs
