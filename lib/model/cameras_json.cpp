// SPDX-License-Identifier: Apache-2.0
// Writes camera poses as JSON.
#include "lib/model/cameras_json.h"

#include <array>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/frame.h"

namespace gs {

void write_cameras_json(const std::filesystem::path& path, const Scene& scene) {
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
                            {"fx", c.fx}});
            if (!offset.isZero(0)) list.back()["offset"] = {offset.x(), offset.y(), offset.z()};
        }
    }
    write_text_atomic(path, json_text(list));
}

}  // namespace gs
