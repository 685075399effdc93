// SPDX-License-Identifier: Apache-2.0
#include "appearance/model_info.h"

#include <algorithm>

namespace gs::appearance {

const ModelInfo& toy_info() {
    static const ModelInfo info = [] {
        ModelInfo m;
        m.name = "toy";
        m.summary = "colour linear in the direction";
        m.default_max_degree = m.max_degree_limit = 1;
        m.residual_width = [](int degree) { return 9 * degree; };
        m.rates = [](int, const RateContext&) { return AppearanceRates{Schedule::constant(0.0007), {Schedule::constant(0.0007)}}; };
        m.init_residual = [](int degree, float* row) { std::fill_n(row, 9 * degree, 0.0f); };
        return m;
    }();
    return info;
}

}  // namespace gs::appearance
