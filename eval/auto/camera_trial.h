// SPDX-License-Identifier: Apache-2.0
// `--refine-cameras auto`: learns the cameras in a short training, and compares it with one that has the given cameras.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Scores of held-out training views after two short trainings, one with the given cameras and one with learned ones.
/// The camera of each view is aligned to the model before it is scored.
struct CameraTrial {
    /// By view: PSNR in dB, with colours aligned if PPISP is on, and SSIM, without
    struct Scores {
        std::vector<double> psnr, ssim;
    };
    std::string obstacle;  ///< reason why nothing could be measured; empty if measured
    Scores given, learned;
    double median_pixels = 0;     ///< median correction of the training images, pixels of their full size
    std::int64_t iterations = 0;  ///< iterations of each of the two trainings
    double seconds = 0;           ///< duration of all measurements
};

/// The decision, with the numbers that it follows from.
struct CameraDecision {
    bool learn = false;
    /// The gain of SSIM with learned cameras as a share of what it lacks to 1 with given ones, and its standard error
    double gain = 0, error = 0;
    double decibels = 0;  ///< the gain of PSNR
    std::string reason;   ///< "on: ..." or "off: ..."
};

/// The smallest CameraDecision::gain for which cameras are learned.
inline constexpr double kLeastCameraGain = 0.04;

/// Measures whether learned cameras are better. Holds out every 8th training view, makes images at most 400 pixels wide
/// and options.cap_max smaller in proportion, and trains twice for a tenth of options.iterations: with the given and
/// with learned cameras. With options.time_limit all measurements have about a tenth of it, as estimated beforehand.
/// Test views are not used. Without a time limit, the same options and seed give the same result except for times.
/// Throws the errors of the training.
CameraTrial try_cameras(const TrainOptions& options, const Scene& scene);

/// Decides to learn the cameras if the gain exceeds kLeastCameraGain and twice its standard error, and PSNR gains, too.
/// SSIM tells wrong cameras from others sooner than PSNR does (docs/lab/cameras.md#auto).
CameraDecision decide_cameras(const CameraTrial& trial);

/// Returns the decision as an event of the training's log.
nlohmann::ordered_json event_of(const CameraTrial& trial, const CameraDecision& decision);

}  // namespace gs
