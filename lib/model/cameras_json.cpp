// SPDX-License-Identifier: Apache-2.0
// Writes camera poses as JSON and reads them back.
#include "lib/model/cameras_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

using Vector = std::array<double, 3>;

int side_of(const nlohmann::json& value) { return int(value.get_ref<const nlohmann::json::number_integer_t&>()); }

ListedView view_of(const nlohmann::json& entry) {
    ListedView view;
    Camera& c = view.camera;
    view.name = entry.at("img_name").get<std::string>();
    view.is_test = entry.at("split") == "test";
    c.width = side_of(entry.at("width")), c.height = side_of(entry.at("height"));
    c.fx = entry.at("fx").get<double>(), c.fy = entry.at("fy").get<double>();
    c.cx = entry.at("cx").get<double>(), c.cy = entry.at("cy").get<double>();
    set_listed_lens(entry, c);
    const auto rows = entry.at("rotation").get<std::array<Vector, 3>>();
    for (int r = 0; r < 3; ++r)
        for (int k = 0; k < 3; ++k) c.rotation(k, r) = rows[std::size_t(r)][std::size_t(k)];
    Eigen::Vector3d position(entry.at("position").get<Vector>().data());
    if (entry.contains("offset")) position += Eigen::Vector3d(entry.at("offset").get<Vector>().data());
    c.translation = -c.rotation * position;
    return view;
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
    const Eigen::Vector3d offset = file_offset(scene.frame);
    const Frame relative{scene.frame.center - offset, scene.frame.scale};
    for (const auto* views : {&scene.test, &scene.train}) {
        for (const View& view : *views) {
            const Camera c = out_of_frame(view.camera, relative);
            const Eigen::Vector3d o = c.center();
            const Eigen::Matrix3d r = c.rotation.transpose();
            const auto row = [&](int i) { return std::array{r(i, 0), r(i, 1), r(i, 2)}; };
            list.push_back({{"id", list.size()},
                            {"img_name", view.name},
                            {"width", c.width},
                            {"height", c.height},
                            {"position", std::array{o.x(), o.y(), o.z()}},
                            {"rotation", std::array{row(0), row(1), row(2)}},
                            {"fy", c.fy},
                            {"fx", c.fx},
                            {"cx", c.cx},
                            {"cy", c.cy},
                            {"split", views == &scene.test ? "test" : "train"}});
            if (!is_pinhole(c)) {
                list.back()["camera_model"] = camera_model_info(c.model).name;
                list.back()["distortion"] = c.distortion;
            }
            if (!offset.isZero(0)) list.back()["offset"] = {offset.x(), offset.y(), offset.z()};
        }
    }
    return json_text(list);
}

void write_cameras_json(const std::filesystem::path& path, const Scene& scene) {
    write_text_atomic(path, cameras_json(scene));
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
