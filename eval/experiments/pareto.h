// SPDX-License-Identifier: Apache-2.0
// Which of several points no other one beats.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace gs {

/// Numbers to be made small: minus the quality, and the costs. No NaN.
using Objectives = std::array<double, 4>;

/// Whether `a` is no worse than `b` in everything and better in something.
bool dominates(const Objectives& a, const Objectives& b);

/// Returns for each point whether no other one dominates it. Equal points do not dominate each other.
std::vector<bool> pareto_front(const std::vector<Objectives>& points);

/// Returns the indices, ascending, of the better half (rounded up): the frontier, then the frontier of the rest, and so
/// on. From the first frontier that does not fit as a whole it takes the points that lie farthest from their neighbours
/// (crowding distance), so that the ends and the spread of this frontier remain.
std::vector<std::size_t> better_half(const std::vector<Objectives>& points);

}  // namespace gs
