// SPDX-License-Identifier: Apache-2.0
// Dominance of points, and which half of them to keep.
#include "eval/experiments/pareto.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace gs {
namespace {

/// Returns for each point the distance between its two neighbours in every objective, relative to the objective's
/// range, summed over the objectives; infinite for the ends.
std::vector<double> crowding_distance(const std::vector<Objectives>& points) {
    std::vector<double> distance(points.size(), 0);
    std::vector<std::size_t> order(points.size());
    for (std::size_t k = 0; k < std::tuple_size_v<Objectives>; ++k) {
        std::iota(order.begin(), order.end(), std::size_t(0));
        std::stable_sort(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return points[a][k] < points[b][k]; });
        const double range = points[order.back()][k] - points[order.front()][k];
        if (!(range > 0) || !std::isfinite(range))
            continue;  // all alike, or a perfect score: says nothing about distances
        distance[order.front()] = distance[order.back()] = std::numeric_limits<double>::infinity();
        for (std::size_t i = 1; i + 1 < order.size(); ++i)
            distance[order[i]] += (points[order[i + 1]][k] - points[order[i - 1]][k]) / range;
    }
    return distance;
}

std::vector<Objectives> chosen(const std::vector<Objectives>& points, const std::vector<std::size_t>& indices) {
    std::vector<Objectives> out;
    for (const std::size_t i : indices) out.push_back(points[i]);
    return out;
}

}  // namespace

bool dominates(const Objectives& a, const Objectives& b) {
    bool better = false;
    for (std::size_t k = 0; k < a.size(); ++k) {
        if (a[k] > b[k]) return false;
        better = better || a[k] < b[k];
    }
    return better;
}

std::vector<bool> pareto_front(const std::vector<Objectives>& points) {
    std::vector<bool> front;
    for (const Objectives& p : points)
        front.push_back(
            std::none_of(points.begin(), points.end(), [&](const Objectives& other) { return dominates(other, p); }));
    return front;
}

std::vector<std::size_t> better_half(const std::vector<Objectives>& points) {
    const std::size_t wanted = (points.size() + 1) / 2;
    std::vector<std::size_t> kept, rest(points.size());
    std::iota(rest.begin(), rest.end(), std::size_t(0));
    while (kept.size() < wanted) {
        const std::vector<bool> in_front = pareto_front(chosen(points, rest));
        std::vector<std::size_t> front, behind;
        for (std::size_t i = 0; i < rest.size(); ++i) (in_front[i] ? front : behind).push_back(rest[i]);
        if (kept.size() + front.size() > wanted) {
            const std::vector<double> distance = crowding_distance(chosen(points, front));
            std::vector<std::size_t> order(front.size());
            std::iota(order.begin(), order.end(), std::size_t(0));
            std::stable_sort(order.begin(), order.end(),
                             [&](std::size_t a, std::size_t b) { return distance[a] > distance[b]; });
            order.resize(wanted - kept.size());
            for (const std::size_t i : order) kept.push_back(front[i]);
        } else {
            kept.insert(kept.end(), front.begin(), front.end());
        }
        rest = behind;
    }
    std::sort(kept.begin(), kept.end());
    return kept;
}

}  // namespace gs
