// SPDX-License-Identifier: Apache-2.0
// Formats cameras, images and points as COLMAP's text files.
#include "lib/scene/colmap_writer.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "lib/io/atomic_file.h"

namespace gs {
namespace {

std::string camera_line(std::size_t id, const LensCamera& lens) {
    const CameraModelInfo& info = camera_model_info(lens.model);
    std::string line = fmt::format("{} {} {} {} {}", id, info.name, lens.width, lens.height, lens.fx);
    if (info.num_focal != 1) line += fmt::format(" {}", lens.fy);
    if (info.num_focal != 0) line += fmt::format(" {} {}", lens.cx, lens.cy);
    for (int k = 0; k < info.num_distortion; ++k) line += fmt::format(" {}", lens.distortion[std::size_t(k)]);
    return line + "\n";
}

}  // namespace

void write_colmap_model(const std::filesystem::path& folder, const std::vector<PosedImage>& images,
                        const SourcePoints& points) {
    std::vector<LensCamera> lenses;
    std::string camera_lines, image_lines;
    for (std::size_t k = 0; k < images.size(); ++k) {
        const PosedImage& image = images[k];
        const auto camera = std::size_t(std::find(lenses.begin(), lenses.end(), image.lens) - lenses.begin());
        if (camera == lenses.size()) {
            lenses.push_back(image.lens);
            camera_lines += camera_line(lenses.size(), image.lens);
        }
        const Eigen::Quaterniond q(image.rotation);
        const Eigen::Vector3d& t = image.translation;
        image_lines += fmt::format("{} {} {} {} {} {} {} {} {} {}\n\n", k + 1, q.w(), q.x(), q.y(), q.z(), t.x(), t.y(),
                                   t.z(), camera + 1, image.name);
    }
    write_text_atomic(folder / "cameras.txt", camera_lines);
    write_text_atomic(folder / "images.txt", image_lines);
    AtomicFile file(folder / "points3D.txt");
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        const Eigen::Vector3d& p = points.positions[i];
        const Eigen::Vector3f color = points.colors[i] * 255.0f;
        file.stream() << fmt::format("{} {} {} {} {:.0f} {:.0f} {:.0f} 0\n", i + 1, p.x(), p.y(), p.z(), color.x(),
                                     color.y(), color.z());
    }
    file.commit();
}

}  // namespace gs
