// SPDX-License-Identifier: Apache-2.0
// Writes and reads Gaussians as the PLY of 3DGS viewers and converters; docs/formats.md shows the layout.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

struct PlyOptions {
    std::int64_t iteration = 0;  ///< iteration stated in the first comment
    std::string note = {};       ///< an additional comment line, if any
    Frame frame = {};            ///< frame of the Gaussians; the file has scene coordinates
};

/// Writes x y z nx ny nz f_dc_0..2 f_rest_0..{0,9,24,45}-1 opacity scale_0..2 rot_0..3 as packed little-endian floats,
/// atomically and without a second copy of the model in memory. Normals are 0 (SIBR expects them), f_rest is
/// channel-major, scales are logarithms, opacities are logits, and rotations are unit quaternions w,x,y,z; moments are
/// not stored. With relu and a model of plain spherical harmonics (ModelInfo::plain_sh) these columns are the complete
/// model, exactly. Otherwise more columns follow after rot_3: app_base_0..2 (the base colour before an activation other
/// than relu; f_dc then holds the visible base colour) and app_<model>_<k> (residual parameters of other models; f_rest
/// is then absent). Weights shared by all Gaussians are a separate element, and a comment states the number of rows
/// with a residual (docs/formats.md). Positions and scales are in scene units. If floats are too coarse for the scene's
/// coordinates, the offset stated in a comment (file_offset) is subtracted from x y z; another comment states the
/// frame, and `SplatRenderMode: mip` or `default` whether the model is antialiased. It must have no 3-D filter
/// (merge_smoothing). Errors: NumericError naming row and property for a value without meaning (whole_model.h);
/// DataError if the write fails.
void write_ply(const std::filesystem::path& path, const Gaussians& gaussians, const PlyOptions& options);

/// Returns the number of bytes per Gaussian in a file of write_ply.
std::int64_t ply_bytes_per_gaussian(const AppearanceSpec& appearance);

/// Reads files of write_ply and other programs: properties by name in any order, float or double. Files without the
/// gsapp comment are read as plain_sh_appearance with all degrees active; the degree follows from the number of f_rest.
/// If the file has the gsapp comment or states a frame, the Gaussians are returned in their training frame, and
/// `*frame` is set to it. Otherwise they are returned in the coordinates of the file, and `*frame` becomes empty.
/// Gaussians with a value without meaning (whole_model.h), or with a rotation of zero, are dropped, and a warning
/// states their number. Rotations may have any length. Errors: DataError naming file, property and row for missing
/// properties, an f_rest count other than 0, 9, 24, 45, a file shorter than its header states (detected before memory
/// is allocated), and a file of which no Gaussian is left; for a file of another kind the message names the kind and a
/// way to convert it to .ply.
Gaussians read_ply(const std::filesystem::path& path, std::optional<Frame>* frame = nullptr);

}  // namespace gs
