// SPDX-License-Identifier: Apache-2.0
// Writes and reads .ngsplat, the packed scene that the viewer loads (docs/formats.md).
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

/// Colour activations by their number in the file. gsapp never trains with kSaturatedExp or kNone.
enum class PackedColorActivation : std::uint32_t { kRelu, kSoftplus, kSigmoid, kSaturatedExp, kHardSigmoid, kNone };

/// A camera as stored in the file; lengths in pixels.
struct PackedCamera {
    float world_from_camera[12];  ///< 3x4, row-major; columns right, down, forward, position
    float fx, fy, cx, cy, width, height;
};

/// Exposure in stops, then colour latents (blue, red, green, neutral) x 2.
using PackedFrame = std::array<float, 9>;

/// The photometric correction without vignetting.
struct PackedPpisp {
    std::array<float, 18> response{};  ///< per channel toe, shoulder, gamma, centre, a, b, activated
    PackedFrame standard{};            ///< correction for free views
    std::vector<PackedFrame> views;    ///< one correction per camera
};

struct PackedScene {
    PackedColorActivation activation = PackedColorActivation::kRelu;
    bool antialiased = false;       ///< as in GaussianState
    bool exponential_base = false;  ///< the base colour is exp(3 d)
    BaseRange base_range;
    std::array<float, 3> center{}, up{0, -1, 0};  ///< the point that the first view orbits, and its up vector
    float distance = 1;
    std::vector<PackedCamera> cameras;  ///< cameras of the views that a page offers
    std::optional<PackedPpisp> ppisp;
    PackedAppearance appearance;
    std::vector<GeometryWords> geometry;  ///< one per Gaussian
    /// JSON after the part that other readers support; empty: no trailer and no checksum.
    std::string trailer;

    std::int64_t count() const { return std::int64_t(geometry.size()); }
    /// Returns whether only some Gaussians have a residual, which the paper's viewer does not support.
    bool is_mixed() const { return !appearance.textures.empty() && appearance.rows < count(); }
    /// Return the mean size of a Gaussian, and the size of a Gaussian with or without a residual.
    double mean_bytes_per_gaussian() const;
    int bytes_per_gaussian(bool with_residual = true) const;
};

/// Returns the width of the file's textures. Gaussians are padded to a multiple of it.
std::int64_t ngsplat_unit();
/// Returns the size in bytes of the file of `scene` with `count` Gaussians and a trailer of `trailer_bytes`. The
/// fraction of Gaussians with a residual is the same as in `scene`.
std::int64_t ngsplat_bytes(const PackedScene& scene, std::int64_t count, std::int64_t trailer_bytes);

/// Writes the file atomically. The sizes of textures and weights must match the appearance's layout; `ppisp->views`
/// must have one entry per camera. Throws DataError.
void write_ngsplat(const std::filesystem::path& path, const PackedScene& scene);

/// Reads files of write_ngsplat and of the paper's exporter. Throws DataError naming the file and the field: wrong
/// magic, values out of range, a file that is shorter or longer than its header states (checked before any allocation),
/// a trailer of a newer version, a wrong checksum.
PackedScene read_ngsplat(const std::filesystem::path& path);

}  // namespace gs
