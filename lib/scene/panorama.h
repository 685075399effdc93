// SPDX-License-Identifier: Apache-2.0
// Photographs of 360 degrees for colmap, which cannot reconstruct their lens: it is given pinhole faces of them, and
// their cameras follow from those of the faces.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/colmap_reader.h"

namespace gs {

/// Faces of one photograph: each of 90 degrees, around the horizon, so that neighbours share a third of what they see.
/// What is above or below 45 degrees is in none: mostly sky, and who holds the camera, who moves along with it.
inline constexpr int kFaces = 6;

/// Returns the name of a face, 0 to kFaces-1, of a photograph "sub/b.png": "face2/sub/b.png.jpg".
std::string face_name(const std::string& photograph, int face);

/// Writes the faces of the photographs in `images` below `folder`, as JPEG, a pixel of which takes as large an angle as
/// one of the photograph at the horizon. Photographs that cannot be read are left out, with a warning. `progress` is
/// called with the number of photographs done, by one thread at a time. Returns the
/// parameters f,cx,cy of their pinholes for colmap, or an empty string if the photographs have several sizes. Throws
/// DataError naming a photograph that is not twice as wide as high (within 1 %) or a face that cannot be written, and
/// Interrupted if the user stopped it.
std::string write_faces(const std::filesystem::path& images, const std::vector<std::string>& photographs,
                        const std::filesystem::path& folder, const std::function<void(std::size_t done)>& progress);

/// The result of write_whole_model.
struct WholeModel {
    std::vector<std::string> photographs;  ///< those with a camera, sorted
    /// Median angle between a face's rotation and its photograph's, degrees; empty if no photograph has two faces.
    std::optional<double> disagreement;
};

/// Writes a COLMAP model, as text, of the photographs whose faces are in `faces`: EQUIRECTANGULAR cameras of the sizes
/// that the files in `images` have, and its points without tracks. A photograph's pose is the mean over its faces
/// within 5 degrees of the one whose position is nearest to all others. Throws DataError for an image that is no face, a
/// photograph that cannot be read, and a file that cannot be written.
WholeModel write_whole_model(const ColmapModel& faces, const std::filesystem::path& images,
                             const std::filesystem::path& folder);

}  // namespace gs
