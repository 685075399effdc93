// SPDX-License-Identifier: Apache-2.0
// Measures the bandwidth and the arithmetic rate that the CPU reaches.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "kernels/base/ceilings.h"
#include "kernels/base/clock.h"
#include "kernels/base/lanes.h"
#include "kernels/base/parallel.h"

namespace gs {
namespace {

/// Returns the best time of a few runs: a ceiling is what is possible.
template <class Fn> double best_seconds(Fn&& fn) {
    double best = 1e9;
    for (int k = 0; k < 5; ++k) {
        const double start = seconds_now();
        fn();
        best = std::min(best, seconds_now() - start);
    }
    return best;
}

}  // namespace

Ceilings cpu_ceilings() {
    constexpr std::int64_t kParts = 64, kFloats = std::int64_t(1) << 20;
    std::vector<float> a(kParts * kFloats, 1.0f), b(kParts * kFloats);
    const double copy = best_seconds([&] {
        parallel_for(kParts,
                     [&](std::int64_t p) { std::copy_n(a.data() + p * kFloats, kFloats, b.data() + p * kFloats); });
    });
    // Ten independent chains hide the latency of the FMA.
    constexpr std::int64_t kRounds = 200000, kChains = 10;
    std::vector<float> sink(kParts);
    const double fma = best_seconds([&] {
        parallel_for(kParts, [&](std::int64_t p) {
            Lanes<float> x[kChains];
            for (std::int64_t c = 0; c < kChains; ++c) x[c] = Lanes<float>(float(c + p));
            const Lanes<float> m(0.999f), k(0.001f);
            for (std::int64_t r = 0; r < kRounds; ++r)
                for (auto& v : x) v = gs_fma(v, m, k);
            for (const auto& v : x) sink[p] += sum_lanes(v);
        });
    });
    return {8.0 * kParts * kFloats / copy, double(kParts) * kRounds * kChains * kLanes / fma};
}

}  // namespace gs
