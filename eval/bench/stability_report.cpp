// SPDX-License-Identifier: Apache-2.0
// Writes the stability measurement as a table and as JSON.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "eval/bench/stability.h"
#include "lib/core/json_text.h"

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

std::string stability_json(const std::vector<StabilityRow>& rows) {
    nlohmann::ordered_json json = {{"rows", nlohmann::ordered_json::array()}};
    for (const StabilityRow& r : rows)
        json["rows"].push_back({{"model", r.model},
                                {"input", r.kind},
                                {"limit", r.limit},
                                {"cases", r.cases},
                                {"forward_error", r.forward_error},
                                {"backward_error", r.backward_error},
                                {"ulp", r.ulp},
                                {"double_error", r.double_error},
                                {"num_nonfinite", r.num_nonfinite},
                                {"num_sign_flips", r.num_sign_flips},
                                {"num_wrong_limits", r.num_wrong_limits}});
    return json_text(json, 1) + "\n";
}

}  // namespace gs
