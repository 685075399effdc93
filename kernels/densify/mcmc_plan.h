// SPDX-License-Identifier: Apache-2.0
// What MCMC densification will do, decided from opacities alone; each backend then moves its own rows.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/backend.h"

namespace gs {

/// One round: sources get the opacity and scale of their share and lose their momentum, then rows are copied.
struct McmcRound {
    std::vector<std::uint32_t> sources;    ///< distinct
    std::vector<float> raw_opacity;        ///< new value, by source
    std::vector<float> log_scale_shift;    ///< added to all three log scales, by source
    std::vector<std::uint32_t> to, from;   ///< parameters of row from[k] are copied to row to[k]
};

struct McmcPlan {
    McmcRound relocate; ///< `to` are dead rows; they keep their moments
    McmcRound grow;     ///< `to` are new rows behind the last one, with zero moments
    std::int64_t count = 0; ///< afterwards
};

/// raw_opacities: (n), updated as the plan will; usable: (n), 0 where the rotation is degenerate. Deterministic in
/// (seed, iteration). Source: densification spec sections 1.1 and 1.2.
McmcPlan plan_mcmc(std::vector<float>& raw_opacities, const std::vector<char>& usable, const McmcParams& params, std::int64_t iteration, std::uint64_t seed);

}  // namespace gs
