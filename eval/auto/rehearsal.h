// SPDX-License-Identifier: Apache-2.0
// Decides before a run which optional parts it has: makes short trainings without and with each of them, and compares
// views that were held out.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// A part of a training that can be decided: its option is `auto`.
enum class Part { kPpisp, kCameras };

/// Returns the option of a part, without dashes.
const char* option_of(Part part);

/// Scores of the held-out views after a short training, by view: PSNR in dB, and SSIM (empty for kPpisp).
struct HeldOutScores {
    std::vector<double> psnr, ssim;
};

/// Short trainings that differ in one part. PPISP: two from the same state, scored after the colours of each render
/// were aligned to its photograph. Cameras: two from the start, scored after the camera of each view was aligned to the
/// model.
struct PartTrial {
    Part part = Part::kPpisp;
    HeldOutScores without{}, with{};
    double correction = 0;        ///< what was learned: the standard deviation of exposures in stops (kPpisp), or the
                                  ///< median correction of cameras in pixels of full-size images (kCameras)
    std::int64_t iterations = 0;  ///< iterations of each training
    double seconds = 0;
    std::string obstacle{};  ///< reason why nothing could be measured; empty if measured
};

/// A decision, with the numbers that it follows from.
struct PartDecision {
    bool on = false;
    /// The mean gain of the score that decides and its standard error: PSNR in dB (kPpisp), or SSIM as a share of what
    /// it lacks to 1 (kCameras)
    double gain = 0, error = 0;
    double decibels = 0;  ///< the gain of PSNR
    std::string reason;   ///< "on: ..." or "off: ..."
};

/// The smallest gains for which a part is on: of PSNR in dB, and of SSIM as a share of what it lacks to 1.
inline constexpr double kLeastPhotometricGain = 0.1, kLeastCameraGain = 0.04;

/// Sets the option of a part to on or off. Without PPISP there is no --ppisp-exif either.
void set_part(TrainOptions& options, Part part, bool on);

/// Measures for each part whose option is `auto` whether it makes held-out views better, and sets the option to on or
/// off by that. Holds out every 8th training view, makes images at most 400 pixels wide and options.cap_max smaller in
/// proportion. If the appearance is `auto`, too, all trainings are without view dependence. Trains three fifteenths of
/// options.iterations for PPISP, then two tenths for the cameras, with PPISP as decided. With options.time_limit all
/// measurements have about a tenth of it, as estimated beforehand. Test views are not used. Without a time limit, the
/// same options and seed give the same result except for times. Throws the errors of the training.
std::vector<PartTrial> rehearse(TrainOptions& options, const Scene& scene);

/// Decides for a part if its gain is clear: the gain of PPISP exceeds kLeastPhotometricGain and its standard error; the
/// gain of cameras kLeastCameraGain and twice its standard error, and PSNR gains, too. SSIM tells wrong cameras from
/// others sooner than PSNR does (docs/lab/cameras.md#auto).
PartDecision decide(const PartTrial& trial);

/// Returns the decision as an event of the training's log.
nlohmann::ordered_json event_of(const PartTrial& trial, const PartDecision& decision);

}  // namespace gs
