// SPDX-License-Identifier: Apache-2.0
// Loads scenes described by transforms*.json: NeRF-synthetic folders, and single files of instant-ngp and nerfstudio.
#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/image_files.h"
#include "lib/scene/point_files.h"
#include "lib/scene/source_scene.h"
#include "lib/scene/split.h"
#include "lib/scene/transforms_reader.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the first folder of all names, which --images replaces. Returns an empty path if the names differ in it or
/// have none, as absolute names do.
fs::path common_folder(const std::vector<std::string>& names) {
    fs::path common;
    for (const std::string& name : names) {
        const fs::path path(name), first = path.has_parent_path() ? *path.begin() : fs::path();
        if (first.empty() || path.is_absolute() || (!common.empty() && first != common)) return {};
        common = first;
    }
    return common;
}

/// Returns the folder of a transforms file, "." for a file in the working folder.
fs::path folder_of(const TransformsFile& file) {
    return file.path.has_parent_path() ? file.path.parent_path() : fs::path(".");
}

/// The frames of one file, with their roles.
struct FrameList {
    const TransformsFile& file;
    const std::vector<TransformsFrame>& frames;
    std::vector<ViewRole> roles;
};

/// Finds the images and masks of frames and creates views from them.
class FrameLoader {
  public:
    /// Throws DataError if the folder given by --images does not exist.
    FrameLoader(const fs::path& folder, const SceneOptions& options, SourceScene& out) : folder_(folder), out_(out) {
        if (options.images == SceneOptions().images) return;
        require_image_folder(folder, options.images);
        out.image_folder = options.images;
    }

    /// Adds the views of all lists. Errors name the file `source`.
    void load(const std::vector<FrameList>& lists, const fs::path& source) {
        std::vector<std::string> names, names_in_scene;
        for (const FrameList& list : lists)
            for (const TransformsFrame& frame : list.frames) names.push_back(frame.file_path);
        const FoundImages found = find(std::move(names));
        out_.notes.insert(out_.notes.end(), found.notes.begin(), found.notes.end());
        out_.facts.insert(out_.facts.end(), found.facts.begin(), found.facts.end());
        for (const FoundImage& image : found.images)
            names_in_scene.push_back((fs::path(out_.image_folder) / image.name).lexically_normal().generic_string());
        MaskFinder masks(folder_, names_in_scene, 1);
        std::size_t next = 0;
        for (const FrameList& list : lists)
            for (std::size_t i = 0; i < list.frames.size(); ++i, ++next)
                add(list, i, found.images[next], names_in_scene[next], masks);
        for (std::string& line : preflight_.report(source.string())) out_.notes.push_back(std::move(line));
        for (const fs::path& images : image_folders_) ImageFolder(images).tell_unread(out_.notes, out_.facts);
        if (!missing_masks_.empty())
            out_.notes.push_back(
                fmt::format("{}: {} of {} files that mask_path names do not exist ({}){}", source.string(),
                            missing_masks_.size(), stated_masks_, listed(missing_masks_),
                            replaced_ == 0 ? ": their images are used whole"
                                           : fmt::format("; {} masks are found by the image's name", replaced_)));
        note_mask_findings(masks, listed_masks_, out_);
    }

  private:
    /// Finds images below the folder given by --images, or else at the paths that the file states.
    FoundImages find(std::vector<std::string> names) const {
        if (out_.image_folder.empty()) return find_images(folder_, names, OutsideNames::kTaken);
        const fs::path images = folder_ / out_.image_folder, common = common_folder(names);
        if (!common.empty() && !folder_exists(images / common))
            for (std::string& name : names) name = fs::path(name).lexically_relative(common).generic_string();
        // Names outside this folder must not bypass the requested folder.
        return find_images(images, names, OutsideNames::kForeign);
    }

    void add(const FrameList& list, std::size_t i, const FoundImage& image, const std::string& name_in_scene,
             MaskFinder& masks) {
        const TransformsFrame& frame = list.frames[i];
        if (masks.is_mask(name_in_scene)) {
            listed_masks_.push_back(frame.file_path);
            return;
        }
        SourceView view;
        view.name = has_image_extension(frame.file_path) || !image.file
                        ? frame.file_path
                        : frame.file_path + image.file->extension().string();
        if (image.file) image_folders_.insert(image.file->parent_path());
        view.rotation = frame.rotation;
        view.translation = frame.translation;
        view.role = list.roles[i];
        if (!preflight_.accept_file(view, image)) {
            if (!view.unreadable.empty()) out_.views.push_back(std::move(view));
            return;
        }
        try {
            view.lens = resolve_intrinsics(frame.intrinsics, view.info.width, view.info.height,
                                           fmt::format("{}: frame '{}'", list.file.path.string(), frame.file_path));
        } catch (const DataError& error) {
            preflight_.reject_camera(error.what());
            return;
        }
        preflight_.choose_turn(view);
        preflight_.fit_lens(view);
        view.mask = mask_of(frame, view, name_in_scene, masks);
        out_.views.push_back(std::move(view));
    }

    std::optional<MaskFile> mask_of(const TransformsFrame& frame, const SourceView& view,
                                    const std::string& name_in_scene, MaskFinder& masks) {
        const fs::path stated = folder_ / frame.mask_path;
        if (!frame.mask_path.empty()) {
            ++stated_masks_;
            if (names_file(stated)) return MaskFile{stated, false};
            missing_masks_.push_back(frame.mask_path);
        }
        std::optional<MaskFile> found = masks.find(name_in_scene, view.name, view.image_path);
        replaced_ += found && !frame.mask_path.empty();
        return found;
    }

    fs::path folder_;
    SourceScene& out_;
    Preflight preflight_;
    std::set<fs::path> image_folders_;
    std::vector<std::string> missing_masks_, listed_masks_;
    std::size_t stated_masks_ = 0, replaced_ = 0;
};

/// Reads the points from the file's ply_file_path, or else from a file beside it with one of the usual names.
void read_points(const TransformsFile& file, const std::vector<std::string>& usual_names, SourceScene& out) {
    const fs::path folder = folder_of(file);
    std::vector<PointFile> files;
    if (!file.point_file.empty()) {
        const fs::path exact = folder / file.point_file;
        if (names_file(exact)) {
            files.push_back({exact});
        } else if (auto bare = point_files(folder, {exact.filename().string()}); !bare.empty()) {
            out.notes.push_back(fmt::format("{}: ply_file_path '{}' does not exist: {} is taken for it",
                                            file.path.string(), file.point_file, bare[0].path.string()));
            files.push_back(std::move(bare[0]));
        } else {
            out.notes.push_back(
                fmt::format("{}: ply_file_path '{}' does not exist: ignored", file.path.string(), file.point_file));
        }
    }
    const std::string rule = files.empty() ? usual_names[0] + " goes first" : "ply_file_path names the first";
    for (PointFile& usual : point_files(folder, usual_names))
        if (std::error_code error; files.empty() || !fs::equivalent(usual.path, files[0].path, error))
            files.push_back(std::move(usual));
    choose_points(std::move(files), rule, out);
}

/// Reads the transforms file of the given name beside `file`, if it exists.
std::optional<TransformsFile> read_beside(const TransformsFile& file, const char* name) {
    const fs::path path = folder_of(file) / name;
    if (!path_exists(path)) return {};
    return read_transforms(path);
}

/// Loads the frames of a file. Unless the file itself states the test views, the frames of transforms_test.json beside
/// it, or else of transforms_val.json, are the test views.
void load_frames(const TransformsFile& file, const SceneOptions& options, SourceScene& out) {
    std::vector<FrameList> lists;
    const auto add = [&](const TransformsFile& from, const std::vector<TransformsFrame>& frames, const char* key,
                         std::vector<ViewRole> roles) {
        leave_out_bad(frames, fmt::format("{} of {}", key, from.path.filename().string()), roles, out.notes);
        lists.push_back({from, frames, std::move(roles)});
    };
    const auto all_test = [](const std::vector<TransformsFrame>& frames) {
        return std::vector(frames.size(), ViewRole::kTest);
    };
    // Test frames come first: of two frames with one name the first counts.
    add(file, file.test_frames, "test_frames", all_test(file.test_frames));
    add(file, file.frames, "frames", roles_of_frames(file, out));
    std::optional<TransformsFile> test;
    for (const char* name : {"transforms_test.json", "transforms_val.json"}) {
        if (file.path.filename() == name) break;
        if (!out.given_split.empty() || !(test = read_beside(file, name))) continue;
        add(*test, test->frames, "frames", all_test(test->frames));
        out.given_split = file.path.filename().string() + " / " + name;
        // 3DGS trains on the views of transforms_test.json if none are held out, but never reads transforms_val.json.
        out.test_views_train = name == std::string_view("transforms_test.json");
    }
    FrameLoader(folder_of(file), options, out).load(lists, file.path);
    out.notes.insert(out.notes.end(), file.notes.begin(), file.notes.end());
    if (test) out.notes.insert(out.notes.end(), test->notes.begin(), test->notes.end());
}

}  // namespace

SourceScene load_nerf_synthetic(const fs::path& folder, const SceneOptions& options) {
    SourceScene out;
    out.kind = "nerf-synthetic";
    out.is_object_in_cube = true;
    const TransformsFile train = read_transforms(folder / "transforms_train.json");
    load_frames(train, options, out);
    read_points(train, {"points3d.ply", "sparse_pc.ply", "pointcloud.ply"}, out);
    return out;
}

SourceScene load_transforms(const fs::path& path, const SceneOptions& options) {
    const TransformsFile file = read_transforms(path);
    SourceScene out;
    out.kind = "transforms";
    load_frames(file, options, out);
    read_points(file, {"sparse_pc.ply", "pointcloud.ply", "points3D.ply"}, out);
    if (out.points.positions.empty()) out.notes.push_back("the scene has no points: random initialisation");
    std::sort(out.views.begin(), out.views.end(),
              [](const SourceView& a, const SourceView& b) { return a.name < b.name; });
    apply_folder_split(out);
    return out;
}

}  // namespace gs
