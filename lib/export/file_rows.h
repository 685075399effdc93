// SPDX-License-Identifier: Apache-2.0
// Which Gaussians a packed file holds, and in which order: a viewer may have the first part of it alone.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns the mean area of an ellipsoid's projections, up to a factor (Thomsen's approximation of its surface).
inline double mean_area(const std::array<double, 3>& s) {
    const auto pair = [&](int i, int j) { return std::pow(s[std::size_t(i)] * s[std::size_t(j)], 1.6); };
    return std::pow(pair(0, 1) + pair(0, 2) + pair(1, 2), 1 / 1.6);
}

/// Returns the Gaussians of `rows`, in that order, without the optimizer's state. Those with a residual come first.
Gaussians selected_rows(const Gaussians& gaussians, const std::vector<std::int64_t>& rows);

/// The number of classes of importance, in each of which Gaussians keep the order of the model.
inline constexpr std::int64_t kImportanceClasses = 16;

/// Returns the first of `count` rows that belongs to class k, and for k = kImportanceClasses the end.
inline std::int64_t class_begin(std::int64_t count, std::int64_t k) { return count * k / kImportanceClasses; }

/// Returns for every place in the file of a mixed model the row that stands there: class by class those with a
/// residual, which are the first `with_residual` rows, and then those without.
std::vector<std::int64_t> interleaved_rows(std::int64_t with_residual, std::int64_t count);

}  // namespace gs
