// SPDX-License-Identifier: Apache-2.0
// Host-side description of the model without view dependence.
#include "appearance/model_info.h"
#include "appearance/none/none.h"
#include "appearance/sh/packing.h"
#include "kernels/base/spherical_harmonics.h"

namespace gs::appearance {

const ModelInfo& none_info() {
    static const ModelInfo info = [] {
        ModelInfo m;
        m.name = "none";
        m.summary = "no view dependence: one colour per Gaussian";
        m.plain_sh = true;  // without any band
        m.residual_width = [](int) { return 0; };
        // The 3DGS rate of SH band 0, with the constant folded into the base colour.
        m.rates = [](int, const RateContext&) { return AppearanceRates{Schedule::constant(0.0025 * kY0), {}}; };
        m.init_residual = [](int, float*) {};
        m.residual = &model_residual<None, double>;
        m.packing = &sh_packing();  // without any band
        return m;
    }();
    return info;
}

}  // namespace gs::appearance
