// SPDX-License-Identifier: Apache-2.0
// Brings two kinds of Gaussians into one order.
#include "lib/export/file_order.h"

namespace gs {

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
