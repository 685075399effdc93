// SPDX-License-Identifier: Apache-2.0
#include "appearance/model_info.h"

#include <algorithm>

#include "packing.h"
#include "toy.h"

namespace gs::appearance {

const ModelInfo& toy_info() {
    static const ModelInfo info = [] {
        ModelInfo m;
        m.name = "toy";
        m.summary = "colour linear in the direction";
        m.options = {{.key = "toy-lr",
                      .default_value = 0.0007,
                      .min = 0,
                      .max = 1,
                      .is_rate = true,
                      .help = "rate of the toy's matrix"}};
        m.default_max_degree = m.max_degree_limit = 1;
        m.residual_width = [](int degree) { return 9 * degree; };
        m.rates = [](int, const RateContext& context) {
            return AppearanceRates{Schedule::constant(0.0007), {Schedule::constant(*context.options.at("toy-lr"))}};
        };
        m.init_residual = [](int degree, float* row) { std::fill_n(row, 9 * degree, 0.0f); };
        m.residual = &model_residual<Toy, double>;
        m.packing = &toy_packing();
        return m;
    }();
    return info;
}

}  // namespace gs::appearance
