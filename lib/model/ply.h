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
    std::int64_t iteration = 0;           ///< stated in the first comment
    std::string render_mode = "default";  ///< "default", or "mip" for an antialiased model whose dilation is 0.3
    std::string note = {};                ///< an additional comment line, if any
    Frame frame = {};                     ///< frame that the Gaussians are in; the file has scene coordinates
};

/// Writes x y z nx ny nz f_dc_0..2 f_rest_0..{0,9,24,45}-1 opacity scale_0..2 rot_0..3 as packed little-endian floats,
/// atomically and without a second copy of the model. Normals are 0 (SIBR expects them), f_rest is channel-major,
/// scales are logarithms, opacities logits, rotations unit quaternions w,x,y,z; moments are not stored. With relu and
/// a model of plain spherical harmonics (ModelInfo::plain_sh) this is the whole model, exactly. Otherwise columns
/// follow after rot_3: app_base_0..2 (the base colour before an activation other than relu; f_dc then holds the visible
/// base colour) and app_<model>_<k> (residual parameters of other models; f_rest is then absent). Weights that all
/// Gaussians share are an element of their own, and a comment says how many rows have a residual (docs/formats.md).
/// Positions and scales
/// are those of the scene; where floats are too coarse for its place, x y z lack the offset that a comment states
/// (file_offset), and another comment states the frame. Errors: NumericError
/// naming row and property for a value without meaning (whole_model.h); DataError when the write fails.
void write_ply(const std::filesystem::path& path, const Gaussians& gaussians, const PlyOptions& options);

/// Returns the bytes of one Gaussian in a file of write_ply.
std::int64_t ply_bytes_per_gaussian(const AppearanceSpec& appearance);

/// Reads files of write_ply and other programs: properties by name in any order, float or double. Files without the
/// gsapp comment are read as plain_sh_appearance of the degree that the number of f_rest says, all degrees active.
/// The Gaussians of a gsapp file are in the frame that they were trained in, which `*frame` becomes; those of other
/// files are as the file has them, and `*frame` becomes empty.
/// Gaussians with a value that has no meaning (whole_model.h), or with a rotation of zero, are left out, which a
/// warning counts. Rotations may have any length.
/// Errors: DataError naming file, property and row for missing properties, an f_rest count other than 0, 9, 24, 45, a
/// file shorter than its header says (found before memory is allocated), and one of which no Gaussian is left; for a
/// file of another kind, what it is and what makes a .ply of it.
Gaussians read_ply(const std::filesystem::path& path, std::optional<Frame>* frame = nullptr);

}  // namespace gs
