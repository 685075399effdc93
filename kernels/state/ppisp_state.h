// SPDX-License-Identifier: Apache-2.0
// The photometric model of a run, in host memory (docs/math/ppisp.md#pipeline, #controller).
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// Number of values per frame: exposure in stops, then colour latents (blue, red, green, neutral) x 2.
inline constexpr int kIspFrameValues = 9;
/// Number of values per camera: 3 channels x vignetting (cx, cy, alpha0, alpha1, alpha2), then 3 channels x raw
/// response (toe, shoulder, gamma, centre).
inline constexpr int kIspVignetting = 5, kIspResponse = 4, kIspCameraValues = 3 * (kIspVignetting + kIspResponse);

// The layers of one controller, in this order. Each holds its weights (outputs, inputs) and then its biases.
inline constexpr int kControllerBins = 5;  ///< the image is averaged to 5x5
inline constexpr int kControllerPool = 3;  ///< side of the squares over which the first layer takes the maximum
inline constexpr int kControllerConv[4] = {3, 16, 32, 64};
inline constexpr int kControllerHidden = 128;
/// The last input is the prior exposure.
inline constexpr int kControllerInputs = kControllerConv[3] * kControllerBins * kControllerBins + 1;
inline constexpr int layer_weights(int inputs, int outputs) { return (inputs + 1) * outputs; }
inline constexpr int kControllerWeights = layer_weights(3, 16) + layer_weights(16, 32) + layer_weights(32, 64) +
                                          layer_weights(kControllerInputs, kControllerHidden) +
                                          2 * layer_weights(kControllerHidden, kControllerHidden) +
                                          layer_weights(kControllerHidden, kIspFrameValues);
static_assert(kControllerWeights == 241961);

/// All trainable values of PPISP. Frames are the training images by index; num_cameras = 0 means no PPISP.
struct PpispState {
    int num_frames = 0, num_cameras = 0;
    std::int64_t step = 0;  ///< optimizer steps of the parameters, which also determine their rate
    /// The parameters and their moments: frames x kIspFrameValues, then cameras x kIspCameraValues. Empty moments are
    /// 0.
    std::vector<float> param, m, v;
    std::int64_t controller_step = 0;
    /// The controllers' weights and their moments (cameras x kControllerWeights), empty before distillation.
    std::vector<float> controller, controller_m, controller_v;

    bool active() const { return num_cameras > 0; }
    std::size_t camera_offset(int camera) const {
        return std::size_t(num_frames) * kIspFrameValues + std::size_t(camera) * kIspCameraValues;
    }
    std::size_t size() const { return camera_offset(num_cameras); }
};

/// Returns a neutral PPISP: exposure 0, neutral colours, no vignetting, straight response.
PpispState identity_ppisp(int num_frames, int num_cameras);

/// Adds a controller with random weights, uniform within 1/sqrt(inputs), to every camera.
void initialize_controller(PpispState& state, std::uint64_t seed);

}  // namespace gs
