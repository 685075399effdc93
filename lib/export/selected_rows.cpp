// SPDX-License-Identifier: Apache-2.0
// Copies rows of all groups.
#include "lib/export/selected_rows.h"

namespace gs {

Gaussians selected_rows(const Gaussians& g, const std::vector<std::int64_t>& rows) {
    Gaussians out;
    out.appearance = g.appearance, out.active_degree = g.active_degree, out.step = g.step, out.shared = g.shared,
    out.ppisp = g.ppisp, out.count = std::int64_t(rows.size());
    for (int k = 0; k < kNumGroups; ++k) {
        const GroupArrays<float>& from = g.groups[k];
        GroupArrays<float>& to = out.groups[k];
        to.width = from.width;
        to.param.reserve(rows.size() * std::size_t(from.width));
        for (const std::int64_t i : rows) {
            if (i >= g.num_rows(Group(k))) break;
            const auto first = from.param.begin() + i * from.width;
            to.param.insert(to.param.end(), first, first + from.width);
        }
    }
    return out;
}

}  // namespace gs
