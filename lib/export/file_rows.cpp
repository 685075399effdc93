// SPDX-License-Identifier: Apache-2.0
// Copies rows of all parameter groups, and interleaves Gaussians with and without a residual.
#include "lib/export/file_rows.h"

namespace gs {

Gaussians selected_rows(const Gaussians& g, const std::vector<std::int64_t>& rows) {
    Gaussians out;
    out.appearance = g.appearance, out.active_degree = g.active_degree, out.step = g.step, out.shared = g.shared,
    out.antialiased = g.antialiased, out.ppisp = g.ppisp, out.count = std::int64_t(rows.size());
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

std::vector<std::int64_t> interleaved_rows(std::int64_t with_residual, std::int64_t count) {
    std::vector<std::int64_t> rows;
    rows.reserve(std::size_t(count));
    for (std::int64_t k = 0; k < kImportanceClasses; ++k) {
        for (std::int64_t i = class_begin(with_residual, k); i < class_begin(with_residual, k + 1); ++i)
            rows.push_back(i);
        const std::int64_t without = count - with_residual;
        for (std::int64_t i = class_begin(without, k); i < class_begin(without, k + 1); ++i)
            rows.push_back(with_residual + i);
    }
    return rows;
}

}  // namespace gs
