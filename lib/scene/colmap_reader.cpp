// SPDX-License-Identifier: Apache-2.0
// Finds COLMAP models and checks the data in their files.
#include "lib/scene/colmap_reader.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <system_error>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/median.h"
#include "lib/scene/colmap_checks.h"

namespace gs {

namespace fs = std::filesystem;

namespace colmap {

// Larger than the image side of any camera, pixels. A larger value means a damaged file.
constexpr std::uint64_t kMaxSide = 1 << 20;

void ModelBuilder::add_camera(const fs::path& file, std::uint32_t id, CameraModel model, std::uint64_t width,
                              std::uint64_t height, std::span<const double> params) {
    const auto fail = [&](const std::string& what) {
        add_unusable_camera(file, id, fmt::format("{}: camera {}: {}", file.string(), id, what));
    };
    if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide)
        return fail(fmt::format("width x height is {} x {}; both must be 1 to {}", width, height, kMaxSide));
    const CameraModelInfo& info = camera_model_info(model);
    for (std::size_t i = 0; i < params.size(); ++i)
        if (!std::isfinite(params[i]))
            return fail(fmt::format("parameter {} of {} is {}; must be finite", i, info.name, params[i]));
    const LensCamera lens = make_lens_camera(model, int(width), int(height), params);
    if (!(lens.fx > 0 && lens.fy > 0))
        return fail(fmt::format("focal length is ({:g}, {:g}); must be positive", lens.fx, lens.fy));
    require_new_camera(file, id);
    model_.cameras.emplace(id, lens);
}

void ModelBuilder::add_unusable_camera(const fs::path& file, std::uint32_t id, std::string reason) {
    require_new_camera(file, id);
    if (unusable_cameras_.empty()) first_unusable_camera_ = reason;
    unusable_cameras_.emplace(id, std::move(reason));
}

void ModelBuilder::require_new_camera(const fs::path& file, std::uint32_t id) const {
    if (model_.cameras.contains(id) || unusable_cameras_.contains(id))
        throw DataError(fmt::format("{}: camera {}: the id appears twice", file.string(), id));
}

void ModelBuilder::add_image(const fs::path& file, std::uint32_t id, const std::array<double, 7>& pose,
                             std::uint32_t camera_id, std::string name, std::vector<ColmapObservation> observations) {
    const auto fail = [&](const std::string& what) {
        throw DataError(fmt::format("{}: image {} ('{}'): {}", file.string(), id, name, what));
    };
    if (!image_ids_.insert(id).second) fail("the id appears twice");
    if (name.empty()) fail("the name is empty");
    if (!model_.cameras.contains(camera_id)) {
        const auto unusable = unusable_cameras_.find(camera_id);
        if (without_camera_++ == 0)
            first_without_camera_ =
                fmt::format("'{}': {}", name,
                            unusable != unusable_cameras_.end()
                                ? unusable->second
                                : fmt::format("{}: image {}: camera_id {} is not among those of {}", file.string(), id,
                                              camera_id, "cameras" + file.extension().string()));
        return;
    }
    Eigen::Quaterniond q(pose[0], pose[1], pose[2], pose[3]);
    const Eigen::Vector3d t(pose[4], pose[5], pose[6]);
    const double norm = q.coeffs().stableNorm();
    // A zero quaternion is not a rotation either.
    if (!std::isfinite(norm) || norm < 1e-12 || !t.allFinite()) {
        if (skipped_images_++ == 0) first_skipped_image_ = name;
        return;
    }
    q.coeffs() /= norm;
    model_.images.push_back({.id = id,
                             .camera_id = camera_id,
                             .name = std::move(name),
                             .rotation = q.toRotationMatrix(),
                             .translation = t,
                             .observations = std::move(observations)});
}

void ModelBuilder::add_point(const fs::path& file, std::uint64_t id, const Eigen::Vector3d& position,
                             const Eigen::Vector3d& rgb) {
    // The check is in float, because a finite double may overflow in float.
    const bool usable = position.cast<float>().allFinite();
    if (model_.rows.contains(id) || skipped_point_ids_.contains(id))
        throw DataError(fmt::format("{}: point {}: the id appears twice", file.string(), id));
    if (!usable) {
        skipped_point_ids_.insert(id);
        return;
    }
    model_.rows.emplace(id, model_.points.positions.size());
    model_.points.positions.push_back(position);
    model_.points.colors.push_back(rgb.cast<float>() / 255.0f);
}

void ModelBuilder::set_unit_colors() {
    for (Eigen::Vector3f& color : model_.points.colors) color *= 255.0f;
}

void ModelBuilder::finish() {
    if (model_.images.empty()) {
        for (const std::string& first : {first_without_camera_, first_unusable_camera_})
            if (!first.empty()) throw DataError(fmt::format("{}; no other image is left", first));
    }
    if (without_camera_ > 0)
        note(fmt::format("{} images are left out because their camera cannot be used (first: {})", without_camera_,
                         first_without_camera_));
    if (skipped_images_ > 0)
        note(fmt::format("{} images with a non-finite or zero pose (first: {}): skipped", skipped_images_,
                         first_skipped_image_));
    if (!skipped_point_ids_.empty())
        note(fmt::format("{} points with non-finite coordinates: skipped", skipped_point_ids_.size()));
}

void read_points(const fs::path& file, ModelBuilder& builder) {
    file.extension() == ".bin" ? read_binary_points(file, builder) : read_text_points(file, builder);
}

}  // namespace colmap

bool is_binary_colmap_model(const fs::path& folder) {
    return path_exists(folder / "cameras.bin") && path_exists(folder / "images.bin");
}

namespace {

bool has_text(const fs::path& folder) {
    return path_exists(folder / "cameras.txt") && path_exists(folder / "images.txt");
}

/// Returns the number of images declared by a model. It is only used to choose between models.
std::uint64_t count_images(const fs::path& folder) {
    if (is_binary_colmap_model(folder)) {
        std::uint64_t count = 0;
        std::ifstream in = open_input(folder / "images.bin");
        in.read(reinterpret_cast<char*>(&count), sizeof(count));
        if (in.bad()) throw DataError(fmt::format("{}: cannot be read", (folder / "images.bin").string()));
        return in ? count : 0;
    }
    return colmap::count_text_images(folder / "images.txt");
}

/// Adds a note that the model's binary files are read, if text files beside them hold another model or are newer.
void note_both_forms(const fs::path& folder, std::vector<std::string>& notes) {
    if (!has_text(folder)) return;
    std::error_code ignored;
    const auto written = [&](const char* name) { return fs::last_write_time(folder / name, ignored); };
    const bool newer = std::max(written("cameras.txt"), written("images.txt")) >
                       std::max(written("cameras.bin"), written("images.bin"));
    const std::uint64_t binary = count_images(folder);
    std::string text = "?";  // unreadable text files are no error, because they are not used
    if (input_fault(folder / "images.txt").empty())
        text = std::to_string(colmap::count_text_images(folder / "images.txt"));
    if (newer || text != std::to_string(binary))
        notes.push_back(fmt::format(
            "{}: the .bin files are read ({} images), not the {}.txt files beside them ({} images): remove those that "
            "are out of date",
            folder.string(), binary, newer ? "newer " : "", text));
}

}  // namespace

fs::path find_colmap_model(const fs::path& scene, std::vector<std::string>& notes) {
    std::vector<std::pair<std::uint64_t, fs::path>> candidates;
    std::vector<std::string> faults;  // messages about entries that cannot be searched
    const auto holds_model = [&](const fs::path& folder) {
        try {
            return folder_exists(folder) && (is_binary_colmap_model(folder) || has_text(folder));
        } catch (const DataError& e) {
            faults.push_back(e.what());
            return false;
        }
    };
    const auto note_faults = [&] {
        for (const std::string& fault : faults) notes.push_back(fault + ": passed over");
    };
    const bool has_models = folder_exists(scene / "sparse");
    for (const fs::path& folder : has_models ? list_folder(scene / "sparse") : std::vector<fs::path>())
        if (holds_model(folder)) candidates.emplace_back(count_images(folder), folder);
    if (!candidates.empty()) {
        note_faults();
        const auto best = *std::min_element(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
            return a.first != b.first ? a.first > b.first : a.second < b.second;
        });
        if (candidates.size() > 1)
            notes.push_back(fmt::format("{} COLMAP models in {}: using {}, which has the most images ({})",
                                        candidates.size(), (scene / "sparse").string(), best.second.filename().string(),
                                        best.first));
        return best.second;
    }
    for (const fs::path& folder : {scene / "sparse", scene}) {
        if (!is_binary_colmap_model(folder) && !has_text(folder)) continue;
        note_faults();
        return folder;
    }
    if (!faults.empty()) throw DataError(faults.front());
    return {};
}

fs::path colmap_point_file(const fs::path& folder) {
    const fs::path binary = folder / "points3D.bin", text = folder / "points3D.txt";
    if (path_exists(binary) && (is_binary_colmap_model(folder) || !path_exists(text))) return binary;
    return path_exists(text) ? text : fs::path();
}

std::vector<PointObservation> observations(const ColmapModel& model, const ColmapImage& image) {
    const LensCamera& lens = model.cameras.at(image.camera_id);
    std::vector<std::pair<const ColmapObservation*, std::size_t>> known;
    for (const ColmapObservation& seen : image.observations)
        if (const auto row = model.rows.find(seen.point); row != model.rows.end())
            known.emplace_back(&seen, row->second);
    std::vector<PointObservation> out(std::min(known.size(), kMostObservations));
    for (std::size_t k = 0; k < out.size(); ++k) {
        const auto& [seen, row] = known[k * known.size() / out.size()];
        out[k] = {model.points.positions[row], {double(seen->x) / lens.width, double(seen->y) / lens.height}};
    }
    return out;
}

SourcePoints read_colmap_points(const fs::path& file, std::vector<std::string>& notes) {
    ColmapModel model;
    colmap::ModelBuilder builder(model);
    colmap::read_points(file, builder);
    builder.finish();
    notes.insert(notes.end(), model.notes.begin(), model.notes.end());
    return std::move(model.points);
}

ColmapModel read_colmap_model(const fs::path& folder) {
    ColmapModel model;
    model.folder = folder;
    colmap::ModelBuilder builder(model);
    if (is_binary_colmap_model(folder)) {
        note_both_forms(folder, model.notes);
        colmap::read_binary(folder, builder);
    } else if (has_text(folder)) {
        colmap::read_text(folder, builder);
    } else {
        throw DataError(fmt::format("{}: no COLMAP model (cameras and images as .bin or .txt) here", folder.string()));
    }
    if (const fs::path points = colmap_point_file(folder); !points.empty()) colmap::read_points(points, builder);
    builder.finish();
    return model;
}

}  // namespace gs
