// SPDX-License-Identifier: Apache-2.0
// Selection and order of the Gaussians in a packed file. A viewer may have received only the first part of the file.
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

/// Returns the Gaussians of `rows`, in that order, without the optimizer state. `rows` must list Gaussians with a
/// residual first.
Gaussians selected_rows(const Gaussians& gaussians, const std::vector<std::int64_t>& rows);

/// Number of importance classes. Within a class Gaussians keep the order of the model.
inline constexpr std::int64_t kImportanceClasses = 16;

/// Returns the first row of class k among `count` rows; for k = kImportanceClasses, `count`.
inline std::int64_t class_begin(std::int64_t count, std::int64_t k) { return count * k / kImportanceClasses; }

/// Returns the row at every position in the file of a mixed model. Each class has first its rows with a residual, taken
/// from the first `with_residual` rows, and then its rows without.
std::vector<std::int64_t> interleaved_rows(std::int64_t with_residual, std::int64_t count);

}  // namespace gs
