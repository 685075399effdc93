// SPDX-License-Identifier: Apache-2.0
// Host-side description of spherical harmonics: parameters, learning rates, initial values.
#include "appearance/model_info.h"

#include <algorithm>

#include "appearance/sh/packing.h"
#include "appearance/sh/sh.h"
#include "kernels/base/spherical_harmonics.h"

namespace gs::appearance {

const ModelInfo& sh_info() {
    static const ModelInfo info = [] {
        ModelInfo m;
        m.name = "sh";
        m.summary = "spherical harmonics of bands 1 to 3, as in 3DGS";
        m.plain_sh = true;
        m.degree_option = "sh-degree";
        m.options = {{.key = m.degree_option,
                      .default_value = 3,
                      .min = 0,
                      .max = 3,
                      .is_whole = true,
                      .help = "with appearance sh: highest band",
                      .measured = "0, 1, 2: lego -1.30, -0.72, -0.24 dB, bonsai -0.88, -0.85, -0.51 "
                                  "([settings](lab/settings.md#options-one-at-a-time))"}};
        m.operations = 85, m.operations_backward = 190;
        m.default_max_degree = 3;
        m.max_degree_limit = 3;
        m.residual_width = [](int degree) { return 3 * ((degree + 1) * (degree + 1) - 1); };
        m.rates = [](int, const RateContext&) {
            return AppearanceRates{Schedule::constant(0.0025 * kY0), {Schedule::constant(0.000125)}};
        };
        m.init_residual = [](int degree, float* row) {
            std::fill(row, row + 3 * ((degree + 1) * (degree + 1) - 1), 0.0f);
        };
        m.stability = [] { return StabilityPlan{std::vector<std::string>(45, "coefficients"), {}}; };
        m.residual = &model_residual<Sh, double>;
        m.packing = &sh_packing();
        return m;
    }();
    return info;
}

}  // namespace gs::appearance
