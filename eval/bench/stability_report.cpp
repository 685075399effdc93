// SPDX-License-Identifier: Apache-2.0
// Writes the stability measurement as a table.
#include <fmt/format.h>

#include "eval/bench/stability.h"

namespace gs {

TextTable stability_table(const std::vector<StabilityRow>& rows) {
    TextTable table;
    table.header = {"model", "input",  "limit reached", "cases",      "forward",     "backward",
                    "ULP",   "double", "non-finite",    "sign flips", "wrong limits"};
    table.num_labels = 3;
    for (const StabilityRow& r : rows)
        table.lines.push_back({{r.model},
                               {r.kind},
                               {r.limit},
                               {fmt::format("{}", r.cases)},
                               {fmt::format("{:.1e}", r.forward_error)},
                               {fmt::format("{:.1e}", r.backward_error)},
                               {fmt::format("{:.1f}", r.ulp)},
                               {fmt::format("{:.1e}", r.double_error)},
                               {fmt::format("{}", r.num_nonfinite)},
                               {fmt::format("{}", r.num_sign_flips)},
                               {fmt::format("{}", r.num_wrong_limits)}});
    return table;
}

}  // namespace gs
