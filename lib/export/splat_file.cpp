// SPDX-License-Identifier: Apache-2.0
// Writes .splat files.
#include "lib/export/splat_file.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "kernels/base/portable.h"
#include "kernels/splat/raster_config.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

struct Record {
    float position[3], scale[3];
    std::uint8_t color[4], rotation[4];
};
static_assert(sizeof(Record) == 32);

std::uint8_t byte(double x) { return std::uint8_t(std::clamp(std::nearbyint(x), 0.0, 255.0)); }

Record record(const Gaussians& g, std::int64_t i, const FileCoordinates& coordinates) {
    const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
    const float* q = row(Group::kRotation);
    const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
    Record r;
    for (int k = 0; k < 3; ++k) {
        r.position[k] = float(coordinates.to_file(row(Group::kMean)[k], k));
        r.scale[k] = float(std::exp(std::min(double(row(Group::kScale)[k]), kMaxLogScale)) / coordinates.frame.scale);
        r.color[k] = byte(255 * (row(Group::kBase)[k] + 0.5));
    }
    r.color[3] = byte(255 * sigmoid(double(*row(Group::kOpacity))));
    for (int k = 0; k < 4; ++k) r.rotation[k] = byte(q[k] / norm * 128 + 128);
    return r;
}

}  // namespace

void write_splat(const std::filesystem::path& path, const Gaussians& g, const Frame& frame) {
    std::vector<double> sizes(static_cast<std::size_t>(g.count));
    for (std::int64_t i = 0; i < g.count; ++i) {
        const float* s = g[Group::kScale].param.data() + 3 * i;
        sizes[std::size_t(i)] =
            double(s[0]) + s[1] + s[2] + std::log(sigmoid(double(g[Group::kOpacity].param[std::size_t(i)])));
    }
    std::vector<std::int64_t> order(static_cast<std::size_t>(g.count));
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::int64_t a, std::int64_t b) { return sizes[std::size_t(a)] > sizes[std::size_t(b)]; });
    const FileCoordinates coordinates{frame, file_offset(frame)};
    AtomicFile file(path);
    for (const std::int64_t i : order) {
        const Record r = record(g, i, coordinates);
        file.stream().write(reinterpret_cast<const char*>(&r), sizeof r);
    }
    file.commit();
}

}  // namespace gs
