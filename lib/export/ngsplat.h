// SPDX-License-Identifier: Apache-2.0
// The .ngsplat container: a packed scene as the viewer loads it (docs/formats.md).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "appearance/packing.h"
#include "lib/export/geometry_codes.h"

namespace gs {

/// Colour activations by their number in the file; kSaturatedExp and kNone are not gsapp's.
enum class PackedColorActivation : std::uint32_t { kRelu, kSoftplus, kSigmoid, kSaturatedExp, kHardSigmoid, kNone };

/// As in the file.
struct PackedCamera {
    float world_from_camera[12];  ///< 3x4, row-major; columns right, down, forward, position
    float fx, fy, cx, cy, width, height;
};

/// Exposure in stops, then colour latents (blue, red, green, neutral) x 2.
using PackedFrame = std::array<float, 9>;

/// Photometric correction without vignetting.
struct PackedPpisp {
    std::array<float, 18> response{};  ///< per channel toe, shoulder, gamma, centre, a, b, activated
    PackedFrame standard{};            ///< of free views
    std::vector<PackedFrame> views;    ///< of each test camera
};

struct PackedScene {
    PackedColorActivation activation = PackedColorActivation::kRelu;
    bool antialiased = false;     ///< dilated by 0.1 with the opacity kept, instead of 0.3
    bool exponential_base = false;  ///< colour before activation is exp(3 d)
    BaseRange base_range;
    std::array<float, 3> center{}, up{0, -1, 0};  ///< what a first view orbits
    float distance = 1;
    std::vector<PackedCamera> cameras;  ///< test cameras
    std::optional<PackedPpisp> ppisp;
    PackedAppearance appearance;
    std::vector<GeometryWords> geometry;  ///< one per Gaussian
    /// JSON behind what other readers know; empty: none, and no checksum.
    std::string trailer;

    std::int64_t count() const { return std::int64_t(geometry.size()); }
    int bytes_per_gaussian() const;
};

/// Writes the file atomically. Sizes of textures and weights are those of the appearance's layout, `ppisp->views` has one entry per
/// camera.
void write_ngsplat(const std::filesystem::path& path, const PackedScene& scene);

/// Reads what write_ngsplat and the paper's exporter write. Throws DataError naming the file and the field: wrong magic, values out
/// of range, a file that is shorter or longer than its header says (found before memory is taken), a trailer of a newer version, a
/// wrong checksum.
PackedScene read_ngsplat(const std::filesystem::path& path);

}  // namespace gs
