// SPDX-License-Identifier: Apache-2.0
// Loads scenes described by transforms*.json: NeRF-synthetic folders, and single files of instant-ngp and nerfstudio.
#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/image_files.h"
#include "lib/scene/source_scene.h"
#include "lib/scene/transforms_reader.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

void append(const TransformsFile& file, Preflight& preflight, bool given_test, SourceScene& out) {
    const fs::path folder = file.path.parent_path();
    std::vector<std::string> names;
    for (const TransformsFrame& frame : file.frames) names.push_back(frame.file_path);
    const FoundImages found = find_images(folder, names, OutsideNames::kTaken);
    out.notes.insert(out.notes.end(), found.notes.begin(), found.notes.end());
    out.facts.insert(out.facts.end(), found.facts.begin(), found.facts.end());
    std::set<fs::path> folders;
    for (std::size_t i = 0; i < file.frames.size(); ++i) {
        const TransformsFrame& frame = file.frames[i];
        const FoundImage& image = found.images[i];
        SourceView view;
        view.name = has_image_extension(frame.file_path) || !image.file
                        ? frame.file_path
                        : frame.file_path + image.file->extension().string();
        if (image.file) folders.insert(image.file->parent_path());
        view.rotation = frame.rotation;
        view.translation = frame.translation;
        view.given_test = given_test;
        if (!preflight.accept_file(view, image)) {
            if (!view.unreadable.empty()) out.views.push_back(std::move(view));
            continue;
        }
        try {
            view.lens = resolve_intrinsics(frame.intrinsics, view.info.width, view.info.height,
                                           fmt::format("{}: frame '{}'", file.path.string(), frame.file_path));
        } catch (const DataError& error) {
            preflight.reject_camera(error.what());
            continue;
        }
        preflight.choose_turn(view);
        preflight.fit_lens(view);
        if (frame.mask_path.empty())
            view.mask = find_mask(folder, image.name, view.image_path, 1);
        else
            view.mask = MaskFile{folder / frame.mask_path, false};
        out.views.push_back(std::move(view));
    }
    for (const fs::path& images : folders) ImageFolder(images).tell_unread(out.notes, out.facts);
    for (const std::string& line : file.notes) out.notes.push_back(line);
}

void finish(const Preflight& preflight, const fs::path& source, SourceScene& out) {
    for (std::string& line : preflight.report(source.string())) out.notes.push_back(std::move(line));
}

void sort_by_name(SourceScene& scene) {
    std::sort(scene.views.begin(), scene.views.end(),
              [](const SourceView& a, const SourceView& b) { return a.name < b.name; });
}

void apply_explicit_split(const TransformsFile& file, SourceScene& out) {
    if (!file.test_filenames) return;
    const std::set<std::string> test(file.test_filenames->begin(), file.test_filenames->end());
    for (SourceView& view : out.views)
        view.given_test = test.contains(view.name) || test.contains(without_extension(view.name));
    out.given_split = "test_filenames of " + file.path.filename().string();
}

}  // namespace

SourceScene load_nerf_synthetic(const fs::path& folder) {
    SourceScene out;
    out.kind = "nerf-synthetic";
    out.is_object_in_cube = true;
    Preflight preflight;
    append(read_transforms(folder / "transforms_train.json"), preflight, false, out);
    if (const fs::path test = folder / "transforms_test.json"; path_exists(test)) {
        append(read_transforms(test), preflight, true, out);
        out.given_split = "transforms_train.json / transforms_test.json";
    }
    finish(preflight, folder / "transforms_train.json", out);
    return out;
}

SourceScene load_transforms(const fs::path& path) {
    const TransformsFile file = read_transforms(path);
    SourceScene out;
    out.kind = "transforms";
    Preflight preflight;
    append(file, preflight, false, out);
    apply_explicit_split(file, out);
    const fs::path test = path.parent_path() / "transforms_test.json";
    if (out.given_split.empty() && path.filename() != test.filename() && path_exists(test)) {
        append(read_transforms(test), preflight, true, out);
        out.given_split = path.filename().string() + " / transforms_test.json";
    }
    finish(preflight, path, out);
    if (!file.point_file.empty()) {
        const fs::path points = path.parent_path() / file.point_file;
        if (path_exists(points))
            out.points = read_point_ply(points);
        else
            out.notes.push_back(
                fmt::format("{}: ply_file_path '{}' does not exist: ignored", path.string(), file.point_file));
    }
    if (out.points.positions.empty()) out.notes.push_back("the scene has no points: random initialisation");
    sort_by_name(out);
    return out;
}

}  // namespace gs
