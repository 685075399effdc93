// SPDX-License-Identifier: Apache-2.0
// Loads a COLMAP scene: model, image folder, masks, points.
#include <fmt/format.h>

#include <algorithm>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/image_files.h"
#include "lib/scene/point_files.h"
#include "lib/scene/source_scene.h"
#include "lib/scene/split.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the names of the existing pre-scaled folders, the one with the largest images first.
std::vector<std::string> scaled_folders(const fs::path& scene, const std::string& images) {
    std::vector<std::string> names;
    for (const int divisor : {2, 4, 8})
        if (const std::string name = fmt::format("{}_{}", images, divisor); folder_exists(scene / name))
            names.push_back(name);
    return names;
}

/// Chooses the image folder: for a divisor, the pre-scaled images_N if it exists. If there is no folder of full-size
/// images, the pre-scaled folder with the largest images takes its place, unless a divisor of the full size is
/// requested. Throws DataError if there is no such folder.
fs::path choose_image_folder(const fs::path& scene, const SceneOptions& options, SourceScene& out) {
    const bool divisor = options.resolution == 2 || options.resolution == 4 || options.resolution == 8;
    if (divisor) {
        const fs::path scaled = scene / fmt::format("{}_{}", options.images, *options.resolution);
        if (folder_exists(scaled)) {
            out.prescaled = *options.resolution;
            out.notes.push_back(fmt::format("images: {} as they are, for resolution {}", scaled.filename().string(),
                                            *options.resolution));
            return scaled;
        }
    }
    const fs::path folder = scene / options.images;
    if (folder_exists(folder)) return folder;
    const std::vector<std::string> scaled = scaled_folders(scene, options.images);
    if (scaled.empty()) require_image_folder(scene, options.images);
    if (options.resolution == 1 || divisor)
        throw DataError(
            fmt::format("{}: image folder '{}' does not exist, of whose size --resolution {} is a part; there are {}: "
                        "take --images {}",
                        scene.string(), options.images, *options.resolution, fmt::join(scaled, ", "), scaled[0]));
    out.facts.push_back(fmt::format("images: {}, because there is no folder '{}'", scaled[0], options.images));
    return scene / scaled[0];
}

/// Pairs names of the full-size folder with files of a pre-scaled folder by sorted order, because some publishers
/// renumber the files. Masks beside the photographs are ignored.
class SortedPairs {
  public:
    SortedPairs(const ImageFolder& full, const ImageFolder& scaled)
        : full_(photographs(full)), scaled_(photographs(scaled)), folder_(scaled.path()) {}

    std::optional<fs::path> find(const std::string& name) const {
        const auto it = std::lower_bound(full_.begin(), full_.end(), name);
        if (full_.size() != scaled_.size() || it == full_.end() || *it != name) return {};
        return folder_ / scaled_[it - full_.begin()];
    }

  private:
    static std::vector<std::string> photographs(const ImageFolder& folder) {
        std::vector<std::string> names = folder.names();
        std::erase_if(names, [](const std::string& name) { return bool(masked_by(name)); });
        return names;
    }

    std::vector<std::string> full_, scaled_;
    fs::path folder_;
};

/// Reads the points from the model folder, or else from its parent folders up to the scene's folder.
void read_points(const fs::path& scene, ColmapModel& model, SourceScene& out) {
    std::vector<PointFile> files;
    const auto add = [&](std::vector<PointFile> found) { files.insert(files.end(), found.begin(), found.end()); };
    const auto add_colmap_points = [&](const fs::path& folder) {
        add(point_files(folder, {"points3D.ply"}));
        if (const fs::path own = colmap_point_file(folder); !own.empty()) files.push_back({own});
    };
    add_colmap_points(model.folder);
    if (!files.empty() && !is_ply(files.back().path)) files.back().points = std::move(model.points);
    fs::path folder = model.folder;
    for (const fs::path& part : model.folder.lexically_relative(scene))
        if (part != ".") add_colmap_points(folder = folder.parent_path());
    add(point_files(scene, {"sparse_pc.ply", "pointcloud.ply", "point_cloud.ply"}));
    choose_points(std::move(files), "points3D.ply goes first, as in 3DGS, then COLMAP's own points", out);
}

}  // namespace

SourceScene load_colmap(const fs::path& scene, const fs::path& model_folder, const SceneOptions& options) {
    ColmapModel model = read_colmap_model(model_folder);
    SourceScene out;
    out.kind = "colmap";
    out.notes = std::move(model.notes);
    const ImageFolder folder(choose_image_folder(scene, options, out));
    const ImageFolder full(out.prescaled > 1 ? scene / options.images : fs::path());
    const SortedPairs pairs(full, folder);
    out.image_folder = folder.path().lexically_relative(scene).generic_string();

    std::vector<std::string> names, names_in_scene, listed_masks;
    for (const ColmapImage& image : model.images) names.push_back(image.name);
    FoundImages found = find_images(folder.path(), names, OutsideNames::kForeign);
    for (std::string& line : found.notes) out.notes.push_back(std::move(line));
    for (std::string& line : found.facts) out.facts.push_back(std::move(line));
    for (const FoundImage& image : found.images)
        names_in_scene.push_back((fs::path(out.image_folder) / image.name).lexically_normal().generic_string());
    MaskFinder masks(scene, names_in_scene, out.prescaled);

    Preflight preflight;
    for (std::size_t i = 0; i < model.images.size(); ++i) {
        const ColmapImage& image = model.images[i];
        if (masks.is_mask(names_in_scene[i])) {
            listed_masks.push_back(image.name);
            continue;
        }
        SourceView view;
        view.name = image.name;
        view.camera_id = int(image.camera_id);
        view.lens = model.cameras.at(image.camera_id);
        view.rotation = image.rotation;
        view.translation = image.translation;
        view.observations = observations(model, image);
        if (!found.images[i].file) found.images[i].file = pairs.find(image.name);
        if (!preflight.accept_file(view, found.images[i])) {
            if (!view.unreadable.empty()) out.views.push_back(std::move(view));
            continue;
        }
        preflight.choose_turn(view);
        // Images of a pre-scaled folder differ in size from the camera by design, so no difference is reported.
        if (out.prescaled > 1)
            view.lens = scaled_to(view.lens, view.info.width, view.info.height);
        else
            preflight.fit_lens(view);
        view.mask = masks.find(names_in_scene[i], found.images[i].name, view.image_path);
        out.views.push_back(std::move(view));
    }
    const fs::path list = model_folder / (is_binary_colmap_model(model_folder) ? "images.bin" : "images.txt");
    for (std::string& line :
         preflight.report(fmt::format("{} with images of {}", list.string(), folder.path().string())))
        out.notes.push_back(std::move(line));
    folder.tell_unread(out.notes, out.facts);
    note_mask_findings(masks, listed_masks, out);
    read_points(scene, model, out);
    if (out.points.positions.empty()) out.notes.push_back("the model has no points: random initialisation");
    std::sort(out.views.begin(), out.views.end(),
              [](const SourceView& a, const SourceView& b) { return a.name < b.name; });
    apply_test_file(model_folder / "test.txt", out);
    apply_folder_split(out);
    return out;
}

}  // namespace gs
