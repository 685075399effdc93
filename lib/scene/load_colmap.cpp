// SPDX-License-Identifier: Apache-2.0
// Loads a COLMAP scene: model, image folder, masks, points.
#include <fmt/format.h>

#include <algorithm>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/io/ply_file.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/image_files.h"
#include "lib/scene/source_scene.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the names of the pre-scaled folders that there are, the one with the largest images first.
std::vector<std::string> scaled_folders(const fs::path& scene, const std::string& images) {
    std::vector<std::string> names;
    for (const int divisor : {2, 4, 8})
        if (const std::string name = fmt::format("{}_{}", images, divisor); folder_exists(scene / name))
            names.push_back(name);
    return names;
}

/// Chooses the folder to read images from: for a divisor the pre-scaled images_N if there is one. Where there is no
/// folder of full-size images, the pre-scaled one with the largest takes its place, unless a divisor of the full size
/// is asked for. Throws DataError if there is no such folder.
fs::path choose_image_folder(const fs::path& scene, const SceneOptions& options, SourceScene& out) {
    const bool divisor = options.resolution == 2 || options.resolution == 4 || options.resolution == 8;
    if (divisor) {
        const fs::path scaled = scene / fmt::format("{}_{}", options.images, options.resolution);
        if (folder_exists(scaled)) {
            out.prescaled = options.resolution;
            out.notes.push_back(fmt::format("images: {} as they are, for resolution {}", scaled.filename().string(),
                                            options.resolution));
            return scaled;
        }
    }
    const fs::path folder = scene / options.images;
    if (folder_exists(folder)) return folder;
    const std::vector<std::string> scaled = scaled_folders(scene, options.images);
    if (scaled.empty())
        throw DataError(fmt::format("{}: image folder '{}' does not exist (choose another with --images)",
                                    scene.string(), options.images));
    if (options.resolution == 1 || divisor)
        throw DataError(
            fmt::format("{}: image folder '{}' does not exist, of whose size --resolution {} is a part; there are {}: "
                        "take --images {}",
                        scene.string(), options.images, options.resolution, fmt::join(scaled, ", "), scaled[0]));
    out.facts.push_back(fmt::format("images: {}, because there is no folder '{}'", scaled[0], options.images));
    return scene / scaled[0];
}

/// Pairs names of the full-size folder with files of a pre-scaled one by sorted order, because some publishers renumber
/// the files.
class SortedPairs {
  public:
    SortedPairs(const ImageFolder& full, const ImageFolder& scaled) : full_(full), scaled_(scaled) {}

    std::optional<fs::path> find(const std::string& name) const {
        const auto& names = full_.names();
        const auto it = std::lower_bound(names.begin(), names.end(), name);
        if (names.size() != scaled_.names().size() || it == names.end() || *it != name) return {};
        return scaled_.path() / scaled_.names()[it - names.begin()];
    }

  private:
    const ImageFolder &full_, &scaled_;
};

void read_points(const fs::path& scene, const fs::path& model_folder, ColmapModel& model, SourceScene& out) {
    out.points = std::move(model.points);
    const bool has_file = path_exists(model_folder / "points3D.bin") || path_exists(model_folder / "points3D.txt");
    for (const fs::path& folder : {model_folder, scene})
        if (const fs::path ply = folder / "points3D.ply";
            !has_file && out.points.positions.empty() && path_exists(ply)) {
            out.points = read_point_ply(ply);
            out.notes.push_back(fmt::format("points: {} from {}", out.points.positions.size(), ply.string()));
        }
}

void note_masks(const SourceScene& scene, std::vector<std::string>& notes) {
    std::size_t images = 0, masks = 0;
    for (const SourceView& view : scene.views) images += view.unreadable.empty(), masks += view.mask.has_value();
    if (masks > 0 && masks < images)
        notes.push_back(fmt::format("{} of {} images have no mask: used whole", images - masks, images));
}

}  // namespace

SourcePoints read_point_ply(const fs::path& path) {
    PlyReader reader(path);
    const int x = reader.require("x"), y = reader.require("y"), z = reader.require("z");
    const int color[3] = {reader.find("red"), reader.find("green"), reader.find("blue")};
    const bool colored = color[0] >= 0 && color[1] >= 0 && color[2] >= 0;
    const bool unit = colored && (reader.header().properties[color[0]].type == PlyType::kFloat ||
                                  reader.header().properties[color[0]].type == PlyType::kDouble);
    SourcePoints points;
    while (const std::int64_t rows = reader.next_chunk())
        for (std::int64_t r = 0; r < rows; ++r) {
            const Eigen::Vector3d p(reader.value(r, x), reader.value(r, y), reader.value(r, z));
            if (!p.cast<float>().allFinite()) continue;
            Eigen::Vector3f rgb = Eigen::Vector3f::Constant(0.5f);
            for (int c = 0; colored && c < 3; ++c)
                rgb[c] = std::clamp(float(reader.value(r, color[c])) / (unit ? 1.0f : 255.0f), 0.0f, 1.0f);
            points.positions.push_back(p);
            points.colors.push_back(rgb.allFinite() ? rgb : Eigen::Vector3f(Eigen::Vector3f::Constant(0.5f)));
        }
    return points;
}

SourceScene load_colmap(const fs::path& scene, const fs::path& model_folder, const SceneOptions& options) {
    ColmapModel model = read_colmap_model(model_folder);
    SourceScene out;
    out.kind = "colmap";
    out.notes = std::move(model.notes);
    const ImageFolder folder(choose_image_folder(scene, options, out));
    const ImageFolder full(out.prescaled > 1 ? scene / options.images : fs::path());
    const SortedPairs pairs(full, folder);
    out.image_folder = folder.path().lexically_relative(scene).generic_string();

    Preflight preflight;
    std::vector<std::string> names;
    for (const ColmapImage& image : model.images) names.push_back(image.name);
    FoundImages found = find_images(folder.path(), names, OutsideNames::kForeign);
    for (std::string& line : found.notes) out.notes.push_back(std::move(line));
    for (std::string& line : found.facts) out.facts.push_back(std::move(line));
    for (std::size_t i = 0; i < model.images.size(); ++i) {
        const ColmapImage& image = model.images[i];
        SourceView view;
        view.name = image.name;
        view.camera_id = int(image.camera_id);
        view.lens = model.cameras.at(image.camera_id);
        view.rotation = image.rotation;
        view.translation = image.translation;
        if (!found.images[i].file) found.images[i].file = pairs.find(image.name);
        if (!preflight.accept_file(view, found.images[i])) {
            if (!view.unreadable.empty()) out.views.push_back(std::move(view));
            continue;
        }
        preflight.choose_turn(view);
        // A pre-scaled folder differs in size from the camera by design, so no difference is reported.
        if (out.prescaled > 1)
            view.lens = scaled_to(view.lens, view.info.width, view.info.height);
        else
            preflight.fit_lens(view);
        view.mask = find_mask(scene, found.images[i].name, view.image_path, out.prescaled);
        out.views.push_back(std::move(view));
    }
    const fs::path list = model_folder / (is_binary_colmap_model(model_folder) ? "images.bin" : "images.txt");
    for (std::string& line :
         preflight.report(fmt::format("{} with images of {}", list.string(), folder.path().string())))
        out.notes.push_back(std::move(line));
    folder.tell_unread(out.notes, out.facts);
    note_masks(out, out.notes);
    read_points(scene, model_folder, model, out);
    if (out.points.positions.empty()) out.notes.push_back("the model has no points: random initialisation");
    std::sort(out.views.begin(), out.views.end(),
              [](const SourceView& a, const SourceView& b) { return a.name < b.name; });
    return out;
}

}  // namespace gs
