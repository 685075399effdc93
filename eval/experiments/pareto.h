// SPDX-License-Identifier: Apache-2.0
// Which of several points no other one beats.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace gs {

/// What is to be made small: minus the quality, and the costs. No NaN.
using Objectives = std::array<double, 4>;

/// Whether `a` is no worse than `b` in everything and better in something.
bool dominates(const Objectives& a, const Objectives& b);

/// Of each point, whether no other dominates it. Equal points do not dominate each other.
std::vector<bool> pareto_front(const std::vector<Objectives>& points);

/// Indices, ascending, of the better half (rounded up): the frontier, then the frontier of the rest, and so on. Of the one that does not
/// fit as a whole those are taken that lie farthest from their neighbours (crowding distance), so that its ends and its spread remain.
std::vector<std::size_t> better_half(const std::vector<Objectives>& points);

}  // namespace gs
