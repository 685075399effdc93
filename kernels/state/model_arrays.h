// SPDX-License-Identifier: Apache-2.0
// The arrays of a model under training, as kernels take them.
#pragma once

#include "kernels/state/gaussian_state.h"

namespace gs {

/// The pointers to the rows of all groups.
struct ModelArrays {
    float *param[kNumGroups], *m[kNumGroups], *v[kNumGroups];
    int width[kNumGroups];
    float *gradient_sum, *gradient_count;       ///< ADC statistic, or null
    float* last_step;                           ///< as in GaussianState, or null where all take each step
    float *shared_param, *shared_m, *shared_v;  ///< weights that all Gaussians share, or null
};

}  // namespace gs
