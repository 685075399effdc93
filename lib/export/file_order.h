// SPDX-License-Identifier: Apache-2.0
// The order of Gaussians in a packed file, of which a viewer may have the first part alone.
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// The number of classes of importance, in each of which Gaussians keep the order of the model.
inline constexpr std::int64_t kImportanceClasses = 16;

/// Returns the first of `count` rows that belongs to class k, and for k = kImportanceClasses the end.
inline std::int64_t class_begin(std::int64_t count, std::int64_t k) { return count * k / kImportanceClasses; }

/// Returns for every place in the file of a mixed model the row that stands there: class by class those with a
/// residual, which are the first `with_residual` rows, and then those without.
std::vector<std::int64_t> interleaved_rows(std::int64_t with_residual, std::int64_t count);

}  // namespace gs
