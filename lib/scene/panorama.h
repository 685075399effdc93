// SPDX-License-Identifier: Apache-2.0
// Panoramas, which are photographs of 360 by 180 degrees, for colmap, which knows their lens only in late versions: it
// gets pinhole faces of them, and their cameras follow from those of the faces.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/colmap_reader.h"

namespace gs {

/// Number of faces of one panorama. They look around the horizon, each 90 degrees wide, so that neighbours share a
/// third of what they show. No face shows the middle of the sky, or the person below the camera, who moves with it.
inline constexpr int kPanoramaFaces = 6;

/// Returns the name of a face, 0 to kPanoramaFaces-1, of a panorama "sub/b.png": "sub/b.png/face2.jpg". Sorted by name,
/// the faces of a panorama stand together.
std::string face_name(const std::string& panorama, int face);

/// Writes the faces of the panoramas in `images` below `folder`, as JPEG, all of one size. In the middle of a face of
/// the widest panorama, a pixel covers the same angle as one of the panorama at the horizon. Panoramas that cannot be
/// read are left out, with a warning. `progress` is called with the numbers of panoramas done and in all, by one thread
/// at a time. Returns the parameters f,cx,cy of their common pinhole for colmap. Throws DataError naming a panorama
/// that is not twice as wide as high (within 1 %) or a face that cannot be written, and Interrupted if the user stopped
/// it.
std::string write_faces(const std::filesystem::path& images, const std::vector<std::string>& panoramas,
                        const std::filesystem::path& folder,
                        const std::function<void(std::size_t done, std::size_t all)>& progress);

/// The result of write_panorama_model.
struct PanoramaModel {
    std::vector<std::string> panoramas;  ///< those with a camera, sorted
    /// Median angle between the rotation of a panorama and that which one of its faces implies, degrees; empty if no
    /// panorama has two faces.
    std::optional<double> disagreement;
    std::vector<std::string> contradictory;  ///< panoramas with faces whose rotations differ by more than 5 degrees
};

/// Writes a COLMAP model, as text, of the panoramas whose faces are in `faces`: EQUIRECTANGULAR cameras of the sizes
/// that the files in `images` have, and the points, without tracks. Faces whose rotation differs by more than 5 degrees
/// from that of the most central face are left out; the pose of the panorama is the mean rotation and the median
/// position, by coordinate, of the others. Throws DataError for an image that is no face, a panorama that cannot be
/// read, and a file that cannot be written.
PanoramaModel write_panorama_model(const ColmapModel& faces, const std::filesystem::path& images,
                                   const std::filesystem::path& folder);

}  // namespace gs
