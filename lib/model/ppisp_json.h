// SPDX-License-Identifier: Apache-2.0
// Writes and reads ppisp.json, the photometric correction of a run (docs/formats.md).
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "kernels/state/ppisp_state.h"

namespace gs {

struct PpispFile {
    struct Frame {
        std::string image;  ///< name of the training image
        int camera = 0;
        std::optional<double> exif_exposure = {};  ///< View::exif_exposure, if known
    };
    std::int64_t iteration = 0;  ///< iteration of the model that the correction belongs to
    bool exif = false;           ///< whether exposures began at EXIF values, which were also an input of the controller
    std::vector<Frame> frames;   ///< in the order of `state`
    double mean_exif = 0;        ///< zero point of the EXIF exposures, stops
    PpispState state;            ///< without moments
};

/// Writes the file atomically: about 14 bytes per number, of which a controller has 241961. Numbers have 9 significant
/// digits, which restore floats bit for bit. `file.frames` and `file.state` must agree in size.
void write_ppisp_json(const std::filesystem::path& path, const PpispFile& file);

/// Reads the file. Throws DataError naming the file (and entry and field if applicable) for a file that is unreadable,
/// truncated or not JSON, for another version, missing fields, lists of the wrong length, numbers that are not finite
/// as floats, and cameras that do not exist.
PpispFile read_ppisp_json(const std::filesystem::path& path);

}  // namespace gs
