// SPDX-License-Identifier: Apache-2.0
// Computes Pareto fronts, the better half of points, and recommendations.
#include "eval/experiments/tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "eval/experiments/tradeoff_text.h"
#include "lib/core/quantities.h"

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
        if (!(range > 0) || !std::isfinite(range)) continue;  // all equal, or a perfect score: no usable range
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

constexpr double kSame = 0.05;  ///< costs that differ by a smaller share count as equal

std::vector<Objectives> objectives(const Tradeoff& tradeoff, const std::vector<std::size_t>& runs) {
    std::vector<Objectives> points;
    for (const std::size_t k : runs) {
        const RunResult& r = *tradeoff.runs[k].result;
        points.push_back({-quality_of(r, tradeoff.quality), *r.train_seconds, *r.frame_seconds, double(*r.bytes)});
    }
    return points;
}

/// Returns e.g. "2.1 times the bytes".
std::string times(double ratio, const std::string& of_what) {
    return fmt::format("{:.{}f} times {}", ratio, ratio < 9.95 ? 1 : 0, of_what);
}

/// Returns "2.1 times LESS" or "1.3 times MORE", or SAME.
std::string compared(double own, double other, const std::string& less, const std::string& more,
                     const std::string& same) {
    if (!(own > 0 && other > 0) || std::abs(own / other - 1) < kSame) return same;
    return own < other ? times(other / own, less) : times(own / other, more);
}

class Recommender {
  public:
    explicit Recommender(const Tradeoff& tradeoff) : tradeoff_(tradeoff), front_(rank_runs(tradeoff).frontier) {}

    std::vector<Recommendation> recommend() const {
        if (front_.empty()) return {};
        const auto bytes = [](const RunResult& r) { return double(*r.bytes); };
        const auto frame = [](const RunResult& r) { return *r.frame_seconds; };
        const std::size_t smallest = least(bytes), fastest = least(frame), best = front_.front();
        std::vector<std::string> given_up;
        if (smallest != best)
            given_up.push_back(times(bytes(result(best)) / bytes(result(smallest)), "the bytes of the smallest"));
        if (fastest != best)
            given_up.push_back(times(frame(result(best)) / frame(result(fastest)), "the frame time of the fastest"));
        const std::string price =
            given_up.empty() ? "gives up nothing" : fmt::format("costs {}", fmt::join(given_up, " and "));
        return {{"best", best, fmt::format("{}; {}", described(best), price)},
                {"smallest", smallest, against_best(smallest, "smaller")},
                {"fastest", fastest,
                 fastest == smallest && fastest != best ? "the smallest itself; " + nothing_is("faster to render")
                                                        : against_best(fastest, "faster to render")}};
    }

  private:
    const RunResult& result(std::size_t k) const { return *tradeoff_.runs[k].result; }
    double quality(std::size_t k) const { return quality_of(result(k), tradeoff_.quality); }

    /// Returns the run of least cost among those close enough to the best quality, or a run of higher quality at about
    /// the same cost.
    template <class Cost> std::size_t least(const Cost& cost) const {
        std::vector<std::size_t> allowed;
        for (const std::size_t k : front_)
            if (quality(k) >= quality(front_.front()) - tradeoff_.give_up) allowed.push_back(k);
        double low = cost(result(allowed.front()));
        for (const std::size_t k : allowed) low = std::min(low, cost(result(k)));
        return *std::find_if(allowed.begin(), allowed.end(),
                             [&](std::size_t k) { return cost(result(k)) <= low * (1 + kSame); });
    }

    std::string described(std::size_t k) const {
        const RunResult& r = result(k);
        return fmt::format("{} ({}, {}, {} FPS, trained in {})",
                           configuration_name(tradeoff_.axes, tradeoff_.runs[k].configuration),
                           quality_text(quality(k), tradeoff_.quality), bytes_text(*r.bytes), fps_text(r),
                           duration_text(*r.train_seconds));
    }

    std::string nothing_is(const std::string& adjective) const {
        return fmt::format("nothing within {} of the best is {} by more than {:.0f} %",
                           loss_text(tradeoff_.give_up, tradeoff_.quality), adjective, 100 * kSame);
    }

    std::string against_best(std::size_t k, const std::string& adjective) const {
        const std::size_t best = front_.front();
        if (k == best) return "the best itself; " + nothing_is(adjective);
        const RunResult &own = result(k), &other = result(best);
        return fmt::format("{}; gives up {} against the best, and is {}, {}, {}", described(k),
                           loss_text(quality(best) - quality(k), tradeoff_.quality),
                           compared(double(*own.bytes), double(*other.bytes), "smaller", "larger", "about as large"),
                           compared(*own.train_seconds, *other.train_seconds, "faster to train", "slower to train",
                                    "about as fast to train"),
                           compared(*own.frame_seconds, *other.frame_seconds, "faster to render", "slower to render",
                                    "about as fast to render"));
    }

    const Tradeoff& tradeoff_;
    const std::vector<std::size_t> front_;
};

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

std::string quality_name(Quality quality) { return quality == Quality::kPsnr ? "PSNR" : "SSIM"; }

double quality_of(const RunResult& result, Quality quality) {
    return quality == Quality::kPsnr ? result.psnr : result.ssim;
}

Ranking rank_runs(const Tradeoff& tradeoff) {
    std::vector<std::size_t> finished;
    for (std::size_t k = 0; k < tradeoff.runs.size(); ++k)
        if (tradeoff.runs[k].result) finished.push_back(k);
    const auto quality = [&](std::size_t k) { return quality_of(*tradeoff.runs[k].result, tradeoff.quality); };
    std::stable_sort(finished.begin(), finished.end(),
                     [&](std::size_t a, std::size_t b) { return quality(a) > quality(b); });
    const std::vector<bool> in_front = pareto_front(objectives(tradeoff, finished));
    Ranking ranking;
    for (std::size_t i = 0; i < finished.size(); ++i)
        (in_front[i] ? ranking.frontier : ranking.dominated).push_back(finished[i]);
    return ranking;
}

std::vector<std::size_t> promoted(const Tradeoff& tradeoff, const std::vector<std::size_t>& runs) {
    std::vector<std::size_t> out;
    for (const std::size_t i : better_half(objectives(tradeoff, runs))) out.push_back(runs[i]);
    return out;
}

std::vector<Recommendation> recommend(const Tradeoff& tradeoff) { return Recommender(tradeoff).recommend(); }

}  // namespace gs
