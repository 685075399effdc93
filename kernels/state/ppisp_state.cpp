// SPDX-License-Identifier: Apache-2.0
// Creates a neutral PPISP state.
#include "kernels/state/ppisp_state.h"

#include <cmath>

#include "kernels/base/rng.h"

namespace gs {

PpispState identity_ppisp(int num_frames, int num_cameras) {
    PpispState state;
    state.num_frames = num_frames, state.num_cameras = num_cameras;
    state.param.assign(state.size(), 0.0f);
    // The inverse of softplus makes toe and shoulder 0.3 + 0.7 and gamma 0.1 + 0.9. The centre is sigmoid(0).
    const float to_one[kIspResponse] = {float(std::log(std::expm1(0.7))), float(std::log(std::expm1(0.7))),
                                        float(std::log(std::expm1(0.9))), 0};
    for (int camera = 0; camera < num_cameras; ++camera) {
        float* response = state.param.data() + state.camera_offset(camera) + 3 * kIspVignetting;
        for (int k = 0; k < 3 * kIspResponse; ++k) response[k] = to_one[k % kIspResponse];
    }
    return state;
}

}  // namespace gs
