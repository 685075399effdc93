// SPDX-License-Identifier: Apache-2.0
// What the stability measurement (eval/bench/stability.h) should know of a model besides its columns: their names, and
// the degenerate cases that no sweep over single parameters would meet.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace gs {

/// One set of inputs. Everything is rounded to float first; float, double and the reference then compute from the same
/// numbers.
struct StabilityCase {
    std::string kind;  ///< the row of the table it belongs to
    /// The raw parameters, as wide as the model's residual at its highest degree; where a case sets them, the shared
    /// weights behind.
    std::vector<double> residual;
    std::array<double, 3> view = {};  ///< mean minus camera centre, any length
    /// The exact residual where it is known without the model's own formulas, and what it is, e.g. "N".
    std::optional<std::array<double, 3>> limit;
    std::string limit_name;
};

struct StabilityPlan {
    std::vector<std::string> column_kinds;  ///< one per residual column; columns of equal kind are swept as one row
    std::vector<StabilityCase> cases;
};

}  // namespace gs
