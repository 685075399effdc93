// SPDX-License-Identifier: Apache-2.0
// Writes camera poses as JSON and reads them back.
#include "lib/model/cameras_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

using Vector = std::array<double, 3>;

int side_of(const nlohmann::json& value) { return int(value.get_ref<const nlohmann::json::number_integer_t&>()); }

/// Returns the camera that an entry states, of the size of the view's.
Camera camera_of(const nlohmann::json& entry, int width, int height) {
    Camera c;
    c.width = width, c.height = height;
    c.fx = entry.at("fx").get<double>(), c.fy = entry.at("fy").get<double>();
    c.cx = entry.at("cx").get<double>(), c.cy = entry.at("cy").get<double>();
    const auto rows = entry.at("rotation").get<std::array<Vector, 3>>();
    for (int r = 0; r < 3; ++r)
        for (int k = 0; k < 3; ++k) c.rotation(k, r) = rows[std::size_t(r)][std::size_t(k)];
    Eigen::Vector3d position(entry.at("position").get<Vector>().data());
    if (entry.contains("offset")) position += Eigen::Vector3d(entry.at("offset").get<Vector>().data());
    c.translation = -c.rotation * position;
    return c;
}

ListedView view_of(const nlohmann::json& entry) {
    ListedView view;
    view.name = entry.at("img_name").get<std::string>();
    view.is_test = entry.at("split") == "test";
    const int width = side_of(entry.at("width")), height = side_of(entry.at("height"));
    view.camera = camera_of(entry, width, height);
    if (entry.contains("given")) view.refined = std::exchange(view.camera, camera_of(entry["given"], width, height));
    if (entry.contains("correction")) view.correction = entry["correction"].get<double>();
    for (Camera* camera : {&view.camera, view.refined ? &*view.refined : nullptr})
        if (camera) set_listed_lens(entry, *camera);
    return view;
}

/// Returns the part of an entry that refining changes.
nlohmann::ordered_json pose_json(const Camera& in_frame, const Frame& frame) {
    const Eigen::Vector3d offset = file_offset(frame);
    const Camera c = out_of_frame(in_frame, Frame{frame.center - offset, frame.scale});
    const Eigen::Vector3d o = c.center();
    const Eigen::Matrix3d r = c.rotation.transpose();
    const auto row = [&](int i) { return std::array{r(i, 0), r(i, 1), r(i, 2)}; };
    nlohmann::ordered_json json = {{"position", std::array{o.x(), o.y(), o.z()}},
                                   {"rotation", std::array{row(0), row(1), row(2)}},
                                   {"fy", c.fy},
                                   {"fx", c.fx},
                                   {"cx", c.cx},
                                   {"cy", c.cy}};
    if (!offset.isZero(0)) json["offset"] = {offset.x(), offset.y(), offset.z()};
    return json;
}

}  // namespace

void set_listed_lens(const nlohmann::json& entry, Camera& camera) {
    if (!entry.contains("camera_model")) return;
    const auto name = entry.at("camera_model").get<std::string>();
    const auto models = camera_models();
    const auto found = std::find_if(models.begin(), models.end(), [&](const auto& m) { return m.name == name; });
    if (found == models.end()) throw DataError(fmt::format("camera_model '{}' is none of COLMAP's", name));
    camera.model = found->id;
    camera.distortion = entry.at("distortion").get<std::array<double, 12>>();
}

std::string cameras_json(const Scene& scene) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const auto* views : {&scene.test, &scene.train}) {
        for (const View& view : *views) {
            const Camera& c = view.camera;
            nlohmann::ordered_json entry = {
                {"id", list.size()}, {"img_name", view.name}, {"width", c.width}, {"height", c.height}};
            entry.update(pose_json(c, scene.frame));
            entry["split"] = views == &scene.test ? "test" : "train";
            if (!is_pinhole(c)) {
                entry["camera_model"] = camera_model_info(c.model).name;
                entry["distortion"] = c.distortion;
            }
            if (view.given) entry["given"] = pose_json(*view.given, scene.frame);
            list.push_back(std::move(entry));
        }
    }
    return json_text(list);
}

std::string with_refined_cameras(const std::string& cameras, const Scene& scene,
                                 const std::vector<double>& corrections) {
    nlohmann::ordered_json list = nlohmann::ordered_json::parse(cameras);
    std::map<std::string, const View*> refined;
    std::map<std::string, double> correction;
    for (const auto* views : {&scene.train, &scene.test})
        for (const View& view : *views)
            if (view.given) refined[view.name] = &view;
    for (std::size_t k = 0; k < corrections.size(); ++k) correction[scene.train[k].name] = corrections[k];
    for (nlohmann::ordered_json& entry : list) {
        const auto found = refined.find(entry.at("img_name").get<std::string>());
        if (found == refined.end()) continue;
        entry.update(pose_json(found->second->camera, scene.frame));
        entry["given"] = pose_json(*found->second->given, scene.frame);
        if (entry["split"] == "train") entry["correction"] = correction.at(found->first);
    }
    return json_text(list);
}

void write_cameras_json(const std::filesystem::path& path, const Scene& scene) {
    write_text_atomic(path, cameras_json(scene));
}

std::vector<ListedView> corrected_views(std::vector<ListedView> views) {
    std::erase_if(views, [](const ListedView& view) { return !view.correction; });
    std::stable_sort(views.begin(), views.end(),
                     [](const ListedView& a, const ListedView& b) { return *a.correction > *b.correction; });
    return views;
}

std::vector<ListedView> read_cameras_json(const std::filesystem::path& path) {
    if (!path_exists(path)) return {};
    const nlohmann::json list = try_parse_json(read_input(path));
    if (!list.is_array()) throw DataError(fmt::format("{}: not a list of cameras (perhaps truncated)", path.string()));
    std::vector<ListedView> views;
    for (const nlohmann::json& entry : list) {
        if (!entry.is_object() || !entry.contains("split")) return {};
        try {
            views.push_back(view_of(entry));
        } catch (const nlohmann::json::exception& e) {
            throw DataError(fmt::format("{}: entry {}: {}", path.string(), views.size(), e.what()));
        }
    }
    return views;
}

}  // namespace gs
