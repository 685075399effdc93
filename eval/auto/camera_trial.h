// SPDX-License-Identifier: Apache-2.0
// `--refine-cameras auto`: learns the cameras in a short training, and compares it with one that has the given cameras.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// What a training with given and one with learned cameras gave on held-out training views, each with its camera
/// aligned to the model.
struct CameraTrial {
    std::string obstacle;               ///< reason why nothing could be measured; empty if measured
    std::vector<double> given, learned;  ///< PSNR of each held-out view, dB
    double median_pixels = 0;           ///< median correction of the training images, pixels of their full size
    std::int64_t iterations = 0;        ///< iterations of each of the two trainings
    double seconds = 0;                 ///< duration of all measurements
};

/// The decision, with the numbers that it follows from.
struct CameraDecision {
    bool learn = false;
    double gain = 0, error = 0;  ///< mean of learned - given, and its standard error, dB
    std::string reason;          ///< "on: ..." or "off: ..."
};

/// The smallest gain of held-out views for which cameras are learned, dB.
inline constexpr double kLeastCameraGain = 0.2;

/// Holds out every 8th training view, makes images at most 400 pixels wide and options.cap_max smaller in proportion,
/// trains for a fifteenth of options.iterations with the given cameras, and from there twice for as long: with the given
/// and with learned cameras. With options.time_limit all measurements have a tenth of it. Test views are not used. The
/// same options and seed give the same result, except for times, unless time ran out. Throws the errors of the training.
CameraTrial try_cameras(const TrainOptions& options, const Scene& scene);

/// Decides to learn the cameras if the held-out views gain kLeastCameraGain and twice the standard error.
CameraDecision decide_cameras(const CameraTrial& trial);

/// Returns the decision as an event of the training's log.
nlohmann::ordered_json event_of(const CameraTrial& trial, const CameraDecision& decision);

}  // namespace gs
